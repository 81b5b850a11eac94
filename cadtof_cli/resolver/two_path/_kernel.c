/* The compiled twins of two_path/, response/ and diffuse/ as one Python module. Each function reads buffers and fills
 * buffers; the module keeps no state.
 *
 * kernel.py is the Python front of the two-path solver; the headers *_call.h and _decomposition.h name the other
 * fronts. The buffers are checked here again: a buffer of the wrong type, size, alignment or layout raises ValueError
 * or TypeError and never crashes. The equations are in the other headers. They are compiled once for every instruction
 * set in LEVELS of _module.h. find_level and levels() ask which of the sets this processor has.
 */
#ifndef Py_GIL_DISABLED
#define Py_LIMITED_API 0x030b0000 /* one build for every Python from 3.11 on */
#endif
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include "../_instruction_sets.h"
#include "_kernel_answers.h"
#include "../_buffers.h"
#include "../diffuse/_pixels_buffers.h"
#include "../diffuse/_patch_steps.h"
#include "../diffuse/_radiosity.h"
#include "../diffuse/_light.h"
#include "../response/_other_pairs.h"

#define WORK(X, name, attributes) \
    X(resolve, resolve_pixels, Frame, name, attributes) \
    X(answer, answer_pixels, TailAnswers, name, attributes) \
    X(decompose, decompose_pixels, Decomposed, name, attributes) \
    X(search, search_pixels, Search, name, attributes) \
    X(follow, follow_pairs, Follow, name, attributes) \
    X(slopes, slopes_of_patches, Slopes, name, attributes) \
    X(step, step_of_patches, Steps, name, attributes) \
    X(matrix, matrix_of, Pairs, name, attributes) \
    X(look, look_at_samples, Sampled, name, attributes) \
    X(sum, sum_patches, Sums, name, attributes) \
    X(count, count_pixels, Counted, name, attributes)
#include "../_module.h"
#include "../_calls.h"

/* --- buffers ------------------------------------------------------------------------------------------------------------- */

enum { CONSTANT_VALUES, STORED, OWN, OTHER, CONSTANT, SAMPLES, METRES, SHIFT, MAP_LAYERS, STATUS, OF_TAIL,
       BUFFERS = OF_TAIL + TAIL_BUFFERS };
static const Wanted BUFFER[BUFFERS] = {
    {"constants", DOUBLES, READ}, {"stored", "H h f d Zd ", 0, READ}, {"own", DOUBLES, MAY_BE_NONE},
    {"other", DOUBLES, MAY_BE_NONE}, {"constant", DOUBLES, MAY_BE_NONE}, {"samples", DOUBLES, MAY_BE_NONE},
    {"metres", DOUBLES, MAY_BE_NONE}, {"shift", DOUBLES, MAY_BE_NONE}, {"layers", FLOATS, WRITE},
    {"status", UINT32S, WRITE}, TAIL_WANTED(MAY_BE_NONE),
};

/* Return 1 if the number of pixels is small enough; otherwise set an error and return 0. */
static int are_pixels(int64_t pixels) {
    if (pixels <= PY_SSIZE_T_MAX / 128) return 1;
    PyErr_SetString(PyExc_ValueError, "found too many pixels, expected fewer");
    return 0;
}

/* Return 1 if any buffer of a tail was given. */
static int has_tail(const Py_buffer *view) {
    for (int which = 0; which < TAIL_BUFFERS; which++)
        if (view[which].obj) return 1;
    return 0;
}

/* Return 1 if the sizes of all buffers fit a frame of this many pixels; otherwise set an error and return 0. */
static int fit_frame(const Py_buffer *view, int64_t pixels) {
    const int64_t complex = view[STORED].format && view[STORED].format[0] == 'Z', four = 4 * pixels;
    int64_t expected[BUFFERS] = {sizeof(Constants) / sizeof(double), complex ? 2 * pixels : four, four, four, four, pixels, pixels, pixels,
                                 LAYERS * pixels, pixels};
    if (has_tail(&view[OF_TAIL]) && !expect_tail(&view[OF_TAIL], pixels, &expected[OF_TAIL])) return 0;
    if (!view[OWN].obj != !view[OTHER].obj || !view[OWN].obj != !view[CONSTANT].obj) {
        PyErr_SetString(PyExc_ValueError, "own, other and constant: found some of them, expected all or none");
        return 0;
    }
    return fit_call(BUFFER, view, BUFFERS, expected);
}

static enum type type_of(const Py_buffer *view) {
    switch (view->format[0]) {
    case 'H': return TYPE_UINT16;
    case 'h': return TYPE_INT16;
    case 'f': return TYPE_FLOAT32;
    case 'd': return TYPE_FLOAT64;
    default: return TYPE_PHASORS;
    }
}

/* --- stored values -> maps ----------------------------------------------------------------------------------------------- */

typedef struct {
    int order, returns, bits;
} Asked;

static PyObject *resolve_checked(const Level *level, const void *options, const Py_buffer *view) {
    const Asked *asked = options;
    const int64_t pixels = values_in(&view[STATUS]);
    if (asked->order < ORDER_AUTO || asked->order > ORDER_TWO || asked->returns < RETURN_FIRST || asked->returns > RETURN_LAST)
        return PyErr_Format(PyExc_ValueError, "found order %d and returns %d, expected 0, 1 or 2 each", asked->order, asked->returns);
    if (asked->bits < -1) return PyErr_Format(PyExc_ValueError, "found bits %d, expected -1 or more", asked->bits);
    if (!are_pixels(pixels) || !fit_frame(view, pixels)) return NULL;
    const int with_tail = has_tail(&view[OF_TAIL]);
    Tail tail;
    if (with_tail && !make_tail(&tail, &view[OF_TAIL])) return NULL;
    if (with_tail && (tail.sizes->harmonics != 2 || tail.number[1] != 2)) return fails("harmonics"), NULL;
    const Frame frame = {
        .stored = view[STORED].buf,
        .constants = view[CONSTANT_VALUES].buf,
        .own = view[OWN].buf,
        .other = view[OTHER].buf,
        .constant = view[CONSTANT].buf,
        .samples = view[SAMPLES].buf,
        .metres = view[METRES].buf,
        .shift = view[SHIFT].buf,
        .tail = with_tail ? &tail : NULL,
        .layers = view[MAP_LAYERS].buf,
        .status = view[STATUS].buf,
        .pixels = pixels,
        .type = type_of(&view[STORED]),
        .bits = asked->bits,
        .order = (enum order)asked->order,
        .returns = (enum returns)asked->returns,
    };
    RETURN_AFTER(level->resolve(&frame));
}

static PyObject *resolve(PyObject *module, PyObject *arguments) {
    (void)module;
    Asked asked = {0};
    return with_buffers(arguments, BUFFER, BUFFERS, resolve_checked, &asked, "iii", &asked.order, &asked.returns, &asked.bits);
}

static PyObject *count_checked(const Level *level, const void *none, const Py_buffer *status) {
    (void)none;
    int64_t counts[4] = {0, 0, 0, 0};
    const Counted counted = {status->buf, values_in(status), counts};
    level->count(&counted);
    return Py_BuildValue("LLLL", (long long)counts[0], (long long)counts[1], (long long)counts[2], (long long)counts[3]);
}

static const Wanted COUNTED_STATUS = {"status", UINT32S, READ};
CALL_OF_BUFFERS(count_status, &COUNTED_STATUS, 1, count_checked)

#include "_decomposition.h"
#include "../diffuse/_pixels_call.h"
#include "../diffuse/_patch_steps_call.h"
#include "../diffuse/_radiosity_call.h"
#include "../diffuse/_light_call.h"
#include "../response/_newton_call.h"
#include "../response/_other_pairs_call.h"

/* --- the module ---------------------------------------------------------------------------------------------------------- */

#define NAME(name) #name,
#define LIST_OF(function, LIST) \
    static PyObject *function(PyObject *module, PyObject *none) { \
        (void)module, (void)none; \
        static const char *const NAMES[] = {LIST(NAME)}; \
        PyObject *names = PyList_New(0); \
        for (size_t i = 0; names && i < sizeof NAMES / sizeof *NAMES; i++) append_name(&names, NAMES[i]); \
        return names; \
    }
LIST_OF(constant_names, CONSTANTS)
LIST_OF(tail_sizes, TAIL_SIZES)
LIST_OF(tail_constants, TAIL_CONSTANTS)

static PyMethodDef METHODS[] = {
    {"resolve", resolve, METH_VARARGS,
     "resolve(level, order, returns, bits, constants, stored, own, other, constant, samples, metres, shift, layers, status, tail...)\n\n"
     "Fill layers and status. Everybody but the tests calls it through kernel.py."},
    {"count_status", count_status, METH_VARARGS,
     "count_status(level, status)\n\nReturn how many pixels have one path, two paths, more, and diffuse MPI."},
    {"answer_tail", answer_tail, METH_VARARGS,
     "answer_tail(level, phasors, usable, samples, answered, answers, tail...)\n\n"
     "Fill answered and answers. Everybody but the tests calls it through diffuse/pixels.py."},
    {"decompose", decompose, METH_VARARGS,
     "decompose(level, first phasors, second phasors, paths)\n\n"
     "Fill paths. Everybody but the tests calls it through decomposition.py."},
    {"tail_slopes", tail_slopes, METH_VARARGS,
     "tail_slopes(level, numbers, rad per ns, onset, state, cosines, sines, seen, beyond, later, total, slopes)\n\n"
     "Fill total and slopes. Everybody but the tests calls it through diffuse/tail.py."},
    {"step_patches", step_patches, METH_VARARGS,
     "step_patches(level, step, data, error, within, pattern, values, slopes, state, linear data, room, spread, answers...)\n\n"
     "Fill the answers of a step. Everybody but the tests calls it through diffuse/patch_steps.py."},
    {"light_matrix", light_matrix, METH_VARARGS,
     "light_matrix(level, rad per m, facing, squares, area, albedo, form factors, matrix, rotors)\n\n"
     "Fill matrix and rotors, and make form factors of heights over planes. Everybody but the tests calls it through diffuse/radiosity.py."},
    {"look_at_samples", look_at, METH_VARARGS,
     "look_at_samples(level, constants, numbers, per variance, places, stored, own, other, constant, hot, samples, weighted, phases, "
     "seen)\n\n"
     "Fill weighted, phases and seen. Everybody but the tests calls it through diffuse/light.py."},
    {"sum_patches", sum_over, METH_VARARGS,
     "sum_patches(level, weighted, counted, sums)\n\n"
     "Fill sums. Everybody but the tests calls it through diffuse/light.py."},
    {"search", search, METH_VARARGS,
     "search(level, steps, constants, first table, second table, phases, observed, enough, start, values, misfit, done)\n\n"
     "Fill values, misfit and done. Everybody but the tests calls it through response/newton.py."},
    {"follow_pairs", follow_pairs_of, METH_VARARGS,
     "follow_pairs(level, constants, tables, phases, phasors, per variance, found, sigma, farthest)\n\n"
     "Fill farthest. Everybody but the tests calls it through response/other_pairs.py."},
    LEVELS_METHOD,
    {"constant_names", constant_names, METH_NOARGS, "Names of the constants, in the order in which resolve takes them."},
    {"tail_sizes", tail_sizes, METH_NOARGS, "Names of a tail's sizes, in the order in which they are taken."},
    {"tail_constants", tail_constants, METH_NOARGS, "Names of a tail's constants, in the order in which they are taken."},
    {NULL, NULL, 0, NULL}};

static struct PyModuleDef MODULE = {.m_base = PyModuleDef_HEAD_INIT,
                                    .m_name = "_kernel",
                                    .m_doc = "Two paths of a sine or of any response, and pixels through a tail, compiled.",
                                    .m_methods = METHODS,
                                    .m_slots = SLOTS};

PyMODINIT_FUNC PyInit__kernel(void) { return PyModuleDef_Init(&MODULE); }
