/* What a call from Python with buffers alone goes through: they are got, checked and released in one place. After _module.h and _buffers.h. */
/* Whether buffers have so many values each, and those from `written` on lie apart from all others; or set an error. */
static int fit_call(const Wanted *wanted, const Py_buffer *view, int count, int written, const int64_t *expected) {
    for (int which = 0; which < count; which++)
        if (!has_values(wanted[which].name, &view[which], expected[which])) return 0;
    for (int which = written; which < count; which++)
        if (view[which].obj && !lies_apart(&view[which], wanted, view, count)) return 0;
    return 1;
}

#define MOST_BUFFERS 16

/* What is done with buffers of the right formats: it checks their sizes, and returns None; or sets an error and returns NULL. */
typedef PyObject *(*Checked)(const Level *level, const void *options, const Py_buffer *view);

/* Do it with the buffers of objects, at the level of a name; they are released afterwards. */
static PyObject *with_buffers(const char *name, const Wanted *wanted, int count, PyObject *const *object, Checked checked,
                              const void *options) {
    const Level *level = find_level(name);
    if (!level) return NULL;
    Py_buffer view[MOST_BUFFERS];
    memset(view, 0, sizeof view);
    PyObject *result = get_buffers(wanted, count, object, view) ? checked(level, options, view) : NULL;
    release_buffers(view, count);
    return result;
}
