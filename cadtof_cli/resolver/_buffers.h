/* Checked access to arrays from Python (buffer protocol). An array that does not fit raises TypeError or ValueError
 * before any of its values is read. */
typedef struct {
    const char *name;
    const char *formats; /* allowed formats of the struct module, each with a space after it */
    int itemsize;        /* in bytes; 0: the size of the format */
    int role;            /* READ, or flags */
} Wanted;

enum { READ, MAY_BE_NONE, WRITE };

/* Formats and sizes. The size of some formats differs between systems. */
#define DOUBLES "d ", 8
#define FLOATS "f ", 4
#define COMPLEX_DOUBLES "Zd ", 16
#define COMPLEX_FLOATS "Zf ", 8
#define INT64S "l q ", 8
#define UINT32S "I L ", 4
#define BOOLS "? ", 1

static int has_format(const char *formats, const char *format) {
    const size_t length = strlen(format);
    for (const char *one = formats; *one; one = strchr(one, ' ') + 1)
        if ((size_t)(strchr(one, ' ') - one) == length && !memcmp(one, format, length)) return 1;
    return 0;
}

/* Fill `view`; its obj stays NULL for None. Otherwise set an error and return 0. */
static int get_buffer(const Wanted *wanted, PyObject *object, Py_buffer *view) {
    if (object == Py_None && wanted->role & MAY_BE_NONE) return 1;
    if (PyObject_GetBuffer(object, view, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | (wanted->role & WRITE ? PyBUF_WRITABLE : 0)) < 0) return 0;
    const char *format = view->format ? view->format : "B";
    if (!has_format(wanted->formats, format) || view->itemsize < 1 || (wanted->itemsize && view->itemsize != wanted->itemsize)) {
        PyErr_Format(PyExc_TypeError, "%s: found values of format %s, expected one of %s", wanted->name, format, wanted->formats);
        return 0;
    }
    const Py_ssize_t part = format[0] == 'Z' ? view->itemsize / 2 : view->itemsize;
    if (view->len && (uintptr_t)view->buf % (uintptr_t)part) {
        PyErr_Format(PyExc_ValueError, "%s: values are not aligned in memory", wanted->name);
        return 0;
    }
    return 1;
}

/* Fill `count` views from `count` objects; the views must be zero before. */
static int get_buffers(const Wanted *wanted, int count, PyObject *const *object, Py_buffer *view) {
    int got = 1;
    for (int which = 0; got && which < count; which++) got = get_buffer(&wanted[which], object[which], &view[which]);
    return got;
}

static void release_buffers(Py_buffer *view, int count) {
    for (int which = 0; which < count; which++)
        if (view[which].obj) PyBuffer_Release(&view[which]);
}

/* Number of values in a buffer; 0 for a buffer that was not given. */
static Py_ssize_t values_in(const Py_buffer *view) { return view->obj ? view->len / view->itemsize : 0; }

static int has_values(const char *name, const Py_buffer *view, int64_t count) {
    if (!view->obj || (values_in(view) == count && view->len % view->itemsize == 0)) return 1;
    PyErr_Format(PyExc_ValueError, "%s: found %zd values, expected %lld", name, values_in(view), (long long)count);
    return 0;
}

static int overlap(const Py_buffer *a, const Py_buffer *b) {
    const uintptr_t first = (uintptr_t)a->buf, second = (uintptr_t)b->buf;
    return a->obj && b->obj && first < second + (uintptr_t)b->len && second < first + (uintptr_t)a->len;
}

/* Return 1 if no other buffer of `of` shares memory with `written`; otherwise set an error and return 0. */
static int lies_apart(const Py_buffer *written, const Wanted *wanted, const Py_buffer *of, int count) {
    for (int which = 0; which < count; which++)
        if (&of[which] != written && overlap(written, &of[which])) {
            PyErr_Format(PyExc_ValueError, "%s: lies in the memory of what is written", wanted[which].name);
            return 0;
        }
    return 1;
}
