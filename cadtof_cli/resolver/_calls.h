/* Every call from Python passes through here: level, options and buffers are fetched, checked and released in one
 * place. Include after _module.h and _buffers.h. */
#include <stdarg.h>

#define MOST_BUFFERS 24

/* Return 1 if every buffer has the expected number of values, and every written buffer lies apart from all others;
 * otherwise set an error and return 0. */
static int fit_call(const Wanted *wanted, const Py_buffer *view, int count, const int64_t *expected) {
    for (int which = 0; which < count; which++)
        if (!has_values(wanted[which].name, &view[which], expected[which])) return 0;
    for (int which = 0; which < count; which++)
        if (wanted[which].role & WRITE && view[which].obj && !lies_apart(&view[which], wanted, view, count)) return 0;
    return 1;
}

/* Read the arguments after the level: first one option per letter of `format`, then up to `count` objects; missing
 * objects become None. On failure set an error and return 0. */
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

/* A function that works on buffers of the right formats. It checks the options and the sizes, and returns the result
 * for Python; or it sets an error and returns NULL. */
typedef PyObject *(*Checked)(const Level *level, const void *options, const Py_buffer *view);

/* Call `checked` with the arguments from Python: the name of a level, the options, and the buffers, which are released
 * afterwards. Each option has a letter in `format` and an address after `format`. */
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

/* Define the function that Python calls with a level and buffers, without options. */
#define CALL_OF_BUFFERS(name, wanted, count, checked) \
    static PyObject *name(PyObject *module, PyObject *arguments) { \
        (void)module; \
        return with_buffers(arguments, wanted, count, checked, NULL, ""); \
    }

/* Compute without Python's lock, then return None. */
#define RETURN_AFTER(computation) \
    Py_BEGIN_ALLOW_THREADS \
    computation; \
    Py_END_ALLOW_THREADS \
    Py_RETURN_NONE
