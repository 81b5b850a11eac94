/* The compiled twin of the two-path solver as a Python module: buffers in, buffers filled, nothing kept.
 *
 * kernel.py is its front. What comes here is checked again all the same: a buffer of the wrong type, size, alignment or layout
 * is a ValueError or TypeError, never a crash. The equations are in the headers beside it, compiled once for every instruction set in
 * LEVELS; which of them this processor has is asked when the module is loaded.
 */
#ifndef Py_GIL_DISABLED
#define Py_LIMITED_API 0x030b0000 /* one build for every Python from 3.11 on */
#endif
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#if defined(__GNUC__) || defined(__clang__)
#define KERNEL_INLINE __attribute__((always_inline))
#else
#define KERNEL_INLINE
#endif
#ifdef _MSC_VER
#define restrict __restrict
#pragma fp_contract(off)
#elif defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#endif
#include "_kernel_answers.h"

/* --- one function for every instruction set ----------------------------------------------------------------------------- */

typedef void Resolve(const Frame *frame, int64_t start, int64_t stop);
typedef struct {
    const char *name;
    Resolve *resolve;
    int (*supported)(void);
} Level;

#define LEVEL(name, attributes) \
    attributes static void resolve_##name(const Frame *frame, int64_t start, int64_t stop) { resolve_pixels(frame, start, stop); }

static int always(void) { return 1; }

#if defined(__x86_64__) && (defined(__GNUC__) || defined(__clang__))
#include <cpuid.h>
#ifdef __clang__
#define WIDE
#else
#define WIDE ",prefer-vector-width=512"
#endif
LEVEL(avx512, __attribute__((target("avx2,avx512f,avx512dq,avx512bw,avx512vl" WIDE))))
LEVEL(avx2, __attribute__((target("avx2"))))
LEVEL(sse2, )

/* Asked of the processor itself: not every compiler's runtime library answers __builtin_cpu_supports. */
static int has(unsigned saved_state, unsigned features) {
    unsigned eax, ebx, ecx, edx, low, high;
    if (!__get_cpuid(1, &eax, &ebx, &ecx, &edx) || !(ecx & bit_OSXSAVE)) return 0;
    __asm__("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    if ((low & saved_state) != saved_state || !__get_cpuid_count(7, 0, &eax, &ebx, &ecx, &edx)) return 0;
    return (ebx & features) == features;
}
static int has_avx512(void) { return has(0xe6, bit_AVX512F | bit_AVX512DQ | bit_AVX512BW | bit_AVX512VL); }
static int has_avx2(void) { return has(0x06, bit_AVX2); }
static const Level LEVELS[] = {
    {"avx512", resolve_avx512, has_avx512}, {"avx2", resolve_avx2, has_avx2}, {"sse2", resolve_sse2, always}};
#elif defined(__aarch64__) || defined(_M_ARM64)
LEVEL(neon, )
static const Level LEVELS[] = {{"neon", resolve_neon, always}};
#else
LEVEL(plain, )
static const Level LEVELS[] = {{"plain", resolve_plain, always}};
#endif
#define LEVEL_COUNT (sizeof LEVELS / sizeof *LEVELS)

static const Level *find_level(const char *name) {
    for (size_t i = 0; i < LEVEL_COUNT; i++)
        if (!strcmp(LEVELS[i].name, name) && LEVELS[i].supported()) return &LEVELS[i];
    return NULL;
}

/* --- buffers ------------------------------------------------------------------------------------------------------------- */

enum { CONSTANT_VALUES, STORED, OWN, OTHER, CONSTANT, SAMPLES, METRES, SHIFT, MAP_LAYERS, STATUS, BUFFERS };
static const struct {
    const char *name;
    const char *formats; /* of the struct module, with a space after each */
    int planes;          /* how many values a pixel has; of STORED: those of voltages */
    int optional, writable;
} BUFFER[BUFFERS] = {
    {"constants", "d ", 0, 0, 0}, {"stored", "H h f d Zd ", 4, 0, 0}, {"own", "d ", 4, 1, 0},
    {"other", "d ", 4, 1, 0},     {"constant", "d ", 4, 1, 0},        {"samples", "d ", 1, 1, 0},
    {"metres", "d ", 1, 1, 0},    {"shift", "d ", 1, 1, 0},           {"layers", "f ", LAYERS, 0, 1},
    {"status", "I L ", 1, 0, 1},
};

#define COUNT(name) +1
enum { CONSTANT_COUNT = 0 CONSTANTS(COUNT) };

static int has_format(const char *formats, const char *format) {
    const size_t length = strlen(format);
    for (const char *one = formats; *one; one = strchr(one, ' ') + 1)
        if ((size_t)(strchr(one, ' ') - one) == length && !memcmp(one, format, length)) return 1;
    return 0;
}

/* Fill `view`, whose obj stays NULL for None, or set an error and return 0. */
static int get_buffer(int which, PyObject *object, Py_buffer *view) {
    const char *name = BUFFER[which].name;
    if (object == Py_None && BUFFER[which].optional) return 1;
    if (PyObject_GetBuffer(object, view, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | (BUFFER[which].writable ? PyBUF_WRITABLE : 0)) < 0)
        return 0;
    const char *format = view->format ? view->format : "B";
    if (!has_format(BUFFER[which].formats, format) || view->itemsize < 1 || (which == STATUS && view->itemsize != 4)) {
        PyErr_Format(PyExc_TypeError, "%s: found values of format %s, expected one of %s", name, format, BUFFER[which].formats);
        return 0;
    }
    const Py_ssize_t part = format[0] == 'Z' ? view->itemsize / 2 : view->itemsize;
    if (view->len && (uintptr_t)view->buf % (uintptr_t)part) {
        PyErr_Format(PyExc_ValueError, "%s: values are not aligned in memory", name);
        return 0;
    }
    return 1;
}

static int has_values(int which, const Py_buffer *view, Py_ssize_t pixels, int planes) {
    if (!view->obj || (view->len / view->itemsize == pixels * planes && view->len % view->itemsize == 0)) return 1;
    PyErr_Format(PyExc_ValueError, "%s: found %zd values, expected %d for each of %zd pixels", BUFFER[which].name,
                 view->len / view->itemsize, planes, pixels);
    return 0;
}

static int overlap(const Py_buffer *a, const Py_buffer *b) {
    const uintptr_t first = (uintptr_t)a->buf, second = (uintptr_t)b->buf;
    return a->obj && b->obj && first < second + (uintptr_t)b->len && second < first + (uintptr_t)a->len;
}

/* Whether all buffers fit a frame of as many pixels as `status` has; or set an error. */
static int fit_together(const Py_buffer *view) {
    const Py_ssize_t pixels = view[STATUS].len / view[STATUS].itemsize;
    if (pixels > PY_SSIZE_T_MAX / 128) {
        PyErr_SetString(PyExc_ValueError, "status: too many pixels");
        return 0;
    }
    if (view[CONSTANT_VALUES].len != (Py_ssize_t)sizeof(Constants)) {
        PyErr_Format(PyExc_ValueError, "constants: found %zd bytes, expected %zu", view[CONSTANT_VALUES].len, sizeof(Constants));
        return 0;
    }
    for (int which = STORED; which < BUFFERS; which++) {
        const int complex = which == STORED && view[which].format && view[which].format[0] == 'Z';
        if (!has_values(which, &view[which], pixels, complex ? 2 : BUFFER[which].planes)) return 0;
    }
    if (!view[OWN].obj != !view[OTHER].obj || !view[OWN].obj != !view[CONSTANT].obj) {
        PyErr_SetString(PyExc_ValueError, "own, other and constant: found some of them, expected all or none");
        return 0;
    }
    for (int which = 0; which < BUFFERS; which++)
        if ((which != MAP_LAYERS && overlap(&view[MAP_LAYERS], &view[which])) ||
            (which != STATUS && overlap(&view[STATUS], &view[which]))) {
            PyErr_Format(PyExc_ValueError, "%s: lies in the memory of what is written", BUFFER[which].name);
            return 0;
        }
    return 1;
}

static enum type type_of(const Py_buffer *view) {
    switch (view->format[0]) {
    case 'H': return UINT16;
    case 'h': return INT16;
    case 'f': return FLOAT32;
    case 'd': return FLOAT64;
    default: return PHASORS;
    }
}

/* --- the module ---------------------------------------------------------------------------------------------------------- */

static PyObject *resolve_checked(const Level *level, int order, int returns, Py_ssize_t start, Py_ssize_t stop,
                                 const Py_buffer *view) {
    if (!fit_together(view)) return NULL;
    const Py_ssize_t pixels = view[STATUS].len / view[STATUS].itemsize;
    if (start < 0 || start > stop || stop > pixels)
        return PyErr_Format(PyExc_ValueError, "found pixels %zd to %zd, expected some of %zd", start, stop, pixels);
    const Frame frame = {
        .stored = view[STORED].buf,
        .constants = view[CONSTANT_VALUES].buf,
        .own = view[OWN].buf,
        .other = view[OTHER].buf,
        .constant = view[CONSTANT].buf,
        .samples = view[SAMPLES].buf,
        .metres = view[METRES].buf,
        .shift = view[SHIFT].buf,
        .layers = view[MAP_LAYERS].buf,
        .status = view[STATUS].buf,
        .pixels = pixels,
        .type = type_of(&view[STORED]),
        .order = (enum order)order,
        .returns = (enum returns)returns,
    };
    Py_BEGIN_ALLOW_THREADS
    level->resolve(&frame, start, stop);
    Py_END_ALLOW_THREADS
    Py_RETURN_NONE;
}

static PyObject *resolve(PyObject *module, PyObject *arguments) {
    (void)module;
    const char *name;
    int order, returns;
    Py_ssize_t start, stop;
    PyObject *object[BUFFERS];
    if (!PyArg_ParseTuple(arguments, "siinnOOOOOOOOOO", &name, &order, &returns, &start, &stop, &object[0], &object[1], &object[2],
                          &object[3], &object[4], &object[5], &object[6], &object[7], &object[8],
                          &object[9]))
        return NULL;
    const Level *level = find_level(name);
    if (!level) return PyErr_Format(PyExc_ValueError, "found level %s, expected one that levels() lists", name);
    if (order < ORDER_AUTO || order > ORDER_TWO || returns < RETURN_FIRST || returns > RETURN_LAST)
        return PyErr_Format(PyExc_ValueError, "found order %d and returns %d, expected 0, 1 or 2 each", order, returns);
    Py_buffer view[BUFFERS];
    memset(view, 0, sizeof view);
    PyObject *result = NULL;
    int got = 1;
    for (int which = 0; got && which < BUFFERS; which++) got = get_buffer(which, object[which], &view[which]);
    if (got) result = resolve_checked(level, order, returns, start, stop, view);
    for (int which = 0; which < BUFFERS; which++)
        if (view[which].obj) PyBuffer_Release(&view[which]);
    return result;
}

static PyObject *levels(PyObject *module, PyObject *none) {
    (void)module, (void)none;
    PyObject *names = PyList_New(0);
    for (size_t i = 0; names && i < LEVEL_COUNT; i++) {
        if (!LEVELS[i].supported()) continue;
        PyObject *name = PyUnicode_FromString(LEVELS[i].name);
        if (!name || PyList_Append(names, name) < 0) Py_CLEAR(names);
        Py_XDECREF(name);
    }
    return names;
}

static PyObject *constant_names(PyObject *module, PyObject *none) {
    (void)module, (void)none;
#define NAME(name) #name,
    static const char *const NAMES[] = {CONSTANTS(NAME)};
    PyObject *names = PyList_New(0);
    for (size_t i = 0; names && i < CONSTANT_COUNT; i++) {
        PyObject *name = PyUnicode_FromString(NAMES[i]);
        if (!name || PyList_Append(names, name) < 0) Py_CLEAR(names);
        Py_XDECREF(name);
    }
    return names;
}

static PyMethodDef METHODS[] = {
    {"resolve", resolve, METH_VARARGS,
     "resolve(level, order, returns, start, stop, constants, stored, own, other, constant, samples, metres, shift, layers, "
     "status)\n\n"
     "Fill layers and status of the pixels from start up to stop. Everybody but the tests calls it through kernel.py."},
    {"levels", levels, METH_NOARGS, "Names of the instruction sets that this processor has, the fastest first."},
    {"constant_names", constant_names, METH_NOARGS, "Names of the constants, in the order in which resolve takes them."},
    {NULL, NULL, 0, NULL}};

static PyModuleDef_Slot SLOTS[] = {
#ifdef Py_mod_gil
    {Py_mod_gil, Py_MOD_GIL_NOT_USED},
#endif
    {0, NULL}};

static struct PyModuleDef MODULE = {.m_base = PyModuleDef_HEAD_INIT,
                                    .m_name = "_kernel",
                                    .m_doc = "Two paths from harmonics 1 and 2, compiled.",
                                    .m_methods = METHODS,
                                    .m_slots = SLOTS};

PyMODINIT_FUNC PyInit__kernel(void) { return PyModuleDef_Init(&MODULE); }
