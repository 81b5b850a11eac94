/* What a call from Python goes through: level, options and buffers are got, checked and released in one place. After _module.h and
 * _buffers.h. */
#include <stdarg.h>

#define MOST_BUFFERS 24

/* Whether buffers have so many values each, and those that are written lie apart from all others; or set an error. */
static int fit_call(const Wanted *wanted, const Py_buffer *view, int count, const int64_t *expected) {
    for (int which = 0; which < count; which++)
        if (!has_values(wanted[which].name, &view[which], expected[which])) return 0;
    for (int which = 0; which < count; which++)
        if (wanted[which].writable && view[which].obj && !lies_apart(&view[which], wanted, view, count)) return 0;
    return 1;
}

/* Fill options, as many as `format` has letters, and objects, None where there are fewer of them than `count`, from what comes after
 * the level; or set an error and return 0. */
static int get_arguments(PyObject *arguments, const char *format, va_list options, int count, PyObject **object) {
    const Py_ssize_t first = 1 + (Py_ssize_t)strlen(format), given = PyTuple_Size(arguments);
    if (given < first || given > first + count) {
        PyErr_Format(PyExc_TypeError, "found %zd arguments, expected %zd and up to %d buffers", given, first, count);
        return 0;
    }
    for (int which = 0; which < count; which++) object[which] = first + which < given ? PyTuple_GetItem(arguments, first + which) : Py_None;
    PyObject *found = PyTuple_GetSlice(arguments, 1, first);
    const int got = found && PyArg_VaParse(found, format, options);
    Py_XDECREF(found);
    return got;
}

/* What is done with buffers of the right formats: it checks options and sizes, and returns what Python gets; or sets an error and
 * returns NULL. */
typedef PyObject *(*Checked)(const Level *level, const void *options, const Py_buffer *view);

/* Do it with what Python hands over: the name of a level, options, of which each has a letter in `format` and an address after it, and
 * buffers, which are released afterwards. */
static PyObject *with_buffers(PyObject *arguments, const Wanted *wanted, int count, Checked checked, const void *options,
                              const char *format, ...) {
    const char *name;
    PyObject *object[MOST_BUFFERS];
    va_list addresses;
    va_start(addresses, format);
    const int got = get_arguments(arguments, format, addresses, count, object);
    va_end(addresses);
    const Level *level = got && PyArg_Parse(PyTuple_GetItem(arguments, 0), "s", &name) ? find_level(name) : NULL;
    if (!level) return NULL;
    Py_buffer view[MOST_BUFFERS];
    memset(view, 0, sizeof view);
    PyObject *result = get_buffers(wanted, count, object, view) ? checked(level, options, view) : NULL;
    release_buffers(view, count);
    return result;
}
