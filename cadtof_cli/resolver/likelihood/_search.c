/* The compiled twins of the search (levenberg_marquardt.py), of the scans for its starts (starts.py) and of the search of Eq. (9) as a
 * Python module: buffers in, buffers filled, nothing kept.
 *
 * compiled.py is its front. What comes here is checked again all the same: a buffer of the wrong type, size, alignment or layout
 * is a ValueError or TypeError, never a crash.
 */
#ifndef Py_GIL_DISABLED
#define Py_LIMITED_API 0x030b0000 /* one build for every Python from 3.11 on */
#endif
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include "../_instruction_sets.h"
#include "_search.h"
#include "_scan.h"
#include "../paper/_shares.h"
#include "../_buffers.h"

typedef struct {
    const char *name;
    void (*search)(const Search *search);
    void (*scan)(const Scan *scan);
    void (*weigh)(const Weigh *weigh);
    void (*shares)(const ShareSearch *search);
    int (*supported)(void);
} Level;

#define FUNCTION(name, attributes, supported) \
    attributes static void search_##name(const Search *search) { search_all(search); } \
    attributes static void scan_##name(const Scan *scan) { scan_all(scan); } \
    attributes static void weigh_##name(const Weigh *weigh) { weigh_all(weigh); } \
    attributes static void shares_##name(const ShareSearch *search) { share_all(search); }
#define LISTED(name, attributes, supported) {#name, search_##name, scan_##name, weigh_##name, shares_##name, supported},
FOR_EACH_LEVEL(FUNCTION)
static const Level LEVELS[] = {FOR_EACH_LEVEL(LISTED)};
#include "../_module.h"

/* --- the search ---------------------------------------------------------------------------------------------------------- */

enum { HARMONICS, RE, IM, WEIGHTS, STARTS, WORTH, POINTS, COST, MATRIX, CONVERGED, STEPS, BUFFERS };
static const Wanted WANTED[BUFFERS] = {
    {"harmonics", "q l ", 8, 0, 0}, {"re", "d ", 8, 0, 0},     {"im", "d ", 8, 0, 0},   {"weights", "d ", 8, 0, 0},
    {"starts", "d ", 8, 0, 0},      {"worth", "d ", 8, 0, 0},  {"points", "d ", 8, 0, 1}, {"cost", "d ", 8, 0, 1},
    {"matrix", "d ", 8, 0, 1},      {"converged", "? ", 1, 0, 1}, {"steps", "q l ", 8, 0, 1},
};

/* Whether kind, paths and harmonics are what there is room for; or set an error. */
static int is_known(int kind, int paths, int most_steps, const Py_buffer *harmonics) {
    const Py_ssize_t rows = values_in(harmonics);
    if (kind < WHITE || kind > WEIGHTED || paths < 1 || paths > MOST_PATHS || most_steps < 0 || rows < 1 ||
        rows > MOST_ROWS) {
        PyErr_Format(PyExc_ValueError, "found kind %d, %d paths, %d steps and %zd harmonics", kind, paths, most_steps, rows);
        return 0;
    }
    const int64_t *number = harmonics->buf;
    for (Py_ssize_t row = 0; row < rows; row++)
        if (number[row] < 1 || number[row] > MOST_HARMONIC) {
            PyErr_Format(PyExc_ValueError, "harmonics: found %lld, expected 1 to %d", (long long)number[row], MOST_HARMONIC);
            return 0;
        }
    return 1;
}

/* Whether all buffers fit as many problems as `cost` has; or set an error. */
static int fit_together(int kind, int paths, const Py_buffer *view) {
    const int64_t count = values_in(&view[COST]), rows = values_in(&view[HARMONICS]);
    const int64_t points = 3 * paths, weights = kind == WHITE ? rows : 3 * rows * count;
    if (count > PY_SSIZE_T_MAX / 4096) {
        PyErr_SetString(PyExc_ValueError, "cost: too many problems");
        return 0;
    }
    const int64_t values[BUFFERS] = {rows,           rows * count, rows * count, weights, points * count, count,
                                     points * count, count,        ENTRY(2 * paths, 0) * count, count, count};
    for (int which = 0; which < BUFFERS; which++) {
        if (!has_values(WANTED[which].name, &view[which], values[which])) return 0;
        if (WANTED[which].writable && !lies_apart(&view[which], WANTED, view, BUFFERS)) return 0;
    }
    return 1;
}

static PyObject *solve_problems(PyObject *module, PyObject *arguments) {
    (void)module;
    const char *name;
    int kind, paths, most_steps;
    double relative, first_damping;
    PyObject *object[BUFFERS];
    if (!PyArg_ParseTuple(arguments, "siiiddOOOOOOOOOOO", &name, &kind, &paths, &most_steps, &relative, &first_damping, &object[0],
                          &object[1], &object[2], &object[3], &object[4], &object[5], &object[6], &object[7], &object[8], &object[9],
                          &object[10]))
        return NULL;
    const Level *level = find_level(name);
    if (!level) return NULL;
    Py_buffer view[BUFFERS];
    memset(view, 0, sizeof view);
    const int sound = get_buffers(WANTED, BUFFERS, object, view) && is_known(kind, paths, most_steps, &view[HARMONICS]) &&
                      fit_together(kind, paths, view);
    if (sound) {
        const Search search = {
            .kind = (enum kind)kind,
            .paths = paths,
            .rows = (int)values_in(&view[HARMONICS]),
            .most_steps = most_steps,
            .count = values_in(&view[COST]),
            .harmonics = view[HARMONICS].buf,
            .relative = relative,
            .first_damping = first_damping,
            .re = view[RE].buf,
            .im = view[IM].buf,
            .weights = view[WEIGHTS].buf,
            .starts = view[STARTS].buf,
            .worth = view[WORTH].buf,
            .points = view[POINTS].buf,
            .cost = view[COST].buf,
            .matrix = view[MATRIX].buf,
            .converged = view[CONVERGED].buf,
            .steps = view[STEPS].buf,
        };
        Py_BEGIN_ALLOW_THREADS
        level->search(&search);
        Py_END_ALLOW_THREADS
    }
    release_buffers(view, BUFFERS);
    if (!sound) return NULL;
    Py_RETURN_NONE;
}

/* --- the weights --------------------------------------------------------------------------------------------------------- */

enum { WEIGH_HARMONICS, NOISE, WEIGH_POINTS, WEIGH_WEIGHTS, WEIGH_BUFFERS };
static const Wanted WEIGH_WANTED[WEIGH_BUFFERS] = {
    {"harmonics", "q l ", 8, 0, 0}, {"noise", "d ", 8, 0, 0}, {"points", "d ", 8, 0, 0}, {"weights", "d ", 8, 0, 1}};

/* Whether all buffers fit as many pixels as `points` has; or set an error. */
static int weigh_fits(int paths, const Py_buffer *view) {
    if (!is_known(WEIGHTED, paths, 0, &view[WEIGH_HARMONICS])) return 0;
    const int64_t rows = values_in(&view[WEIGH_HARMONICS]), count = values_in(&view[WEIGH_POINTS]) / (3 * paths);
    const int64_t values[WEIGH_BUFFERS] = {rows, 3 * rows, 3 * paths * count, 3 * rows * count};
    for (int which = 0; which < WEIGH_BUFFERS; which++)
        if (!has_values(WEIGH_WANTED[which].name, &view[which], values[which])) return 0;
    return lies_apart(&view[WEIGH_WEIGHTS], WEIGH_WANTED, view, WEIGH_BUFFERS);
}

static PyObject *weigh_pixels(PyObject *module, PyObject *arguments) {
    (void)module;
    const char *name;
    int paths;
    PyObject *object[WEIGH_BUFFERS];
    if (!PyArg_ParseTuple(arguments, "siOOOO", &name, &paths, &object[0], &object[1], &object[2], &object[3])) return NULL;
    const Level *level = find_level(name);
    if (!level) return NULL;
    Py_buffer view[WEIGH_BUFFERS];
    memset(view, 0, sizeof view);
    const int sound = get_buffers(WEIGH_WANTED, WEIGH_BUFFERS, object, view) && weigh_fits(paths, view);
    if (sound) {
        const int64_t count = values_in(&view[WEIGH_POINTS]) / (3 * paths);
        const Weigh weigh = {paths, (int)values_in(&view[WEIGH_HARMONICS]), count, view[WEIGH_HARMONICS].buf, view[NOISE].buf,
                             view[WEIGH_POINTS].buf, view[WEIGH_WEIGHTS].buf};
        Py_BEGIN_ALLOW_THREADS
        level->weigh(&weigh);
        Py_END_ALLOW_THREADS
    }
    release_buffers(view, WEIGH_BUFFERS);
    if (!sound) return NULL;
    Py_RETURN_NONE;
}

/* --- the scan ------------------------------------------------------------------------------------------------------------ */

enum { FACTORS, LAGS, SCAN_RE, SCAN_IM, FIRST, LAG, PEAK, OTHER, SCAN_BUFFERS };
static const Wanted SCAN_WANTED[SCAN_BUFFERS] = {
    {"factors", "d ", 8, 0, 0}, {"lags", "d ", 8, 0, 0},   {"re", "d ", 8, 0, 0},   {"im", "d ", 8, 0, 0},
    {"first", "q l ", 8, 0, 1}, {"lag", "q l ", 8, 0, 1}, {"peak", "d ", 8, 0, 1}, {"other", "d ", 8, 0, 1},
};

/* Whether all buffers fit as many pixels as `first` has; or set an error. */
static int scan_fits(int rows, int places, const Py_buffer *view) {
    const int64_t count = values_in(&view[FIRST]);
    if (rows < 1 || rows > MOST_ROWS || places < 2 || places > MOST_PLACES || count > PY_SSIZE_T_MAX / 4096) {
        PyErr_Format(PyExc_ValueError, "found %d harmonics, %d places and %lld pixels", rows, places, (long long)count);
        return 0;
    }
    const int64_t values[SCAN_BUFFERS] = {2 * rows * places, 3 * (places / 2), rows * count, rows * count, count, count, count, count};
    for (int which = 0; which < SCAN_BUFFERS; which++)
        if (!has_values(SCAN_WANTED[which].name, &view[which], values[which]) ||
            (SCAN_WANTED[which].writable && !lies_apart(&view[which], SCAN_WANTED, view, SCAN_BUFFERS)))
            return 0;
    return 1;
}

static PyObject *scan_pixels(PyObject *module, PyObject *arguments) {
    (void)module;
    const char *name;
    int rows, places, pairs;
    PyObject *object[SCAN_BUFFERS];
    if (!PyArg_ParseTuple(arguments, "siipOOOOOOOO", &name, &rows, &places, &pairs, &object[0], &object[1], &object[2], &object[3],
                          &object[4], &object[5], &object[6], &object[7]))
        return NULL;
    const Level *level = find_level(name);
    if (!level) return NULL;
    Py_buffer view[SCAN_BUFFERS];
    memset(view, 0, sizeof view);
    const int sound = get_buffers(SCAN_WANTED, SCAN_BUFFERS, object, view) && scan_fits(rows, places, view);
    if (sound) {
        const Scan scan = {rows, places, pairs, values_in(&view[FIRST]), view[FACTORS].buf, view[LAGS].buf, view[SCAN_RE].buf,
                           view[SCAN_IM].buf, view[FIRST].buf, view[LAG].buf, view[PEAK].buf, view[OTHER].buf};
        Py_BEGIN_ALLOW_THREADS
        level->scan(&scan);
        Py_END_ALLOW_THREADS
    }
    release_buffers(view, SCAN_BUFFERS);
    if (!sound) return NULL;
    Py_RETURN_NONE;
}

/* --- Eq. (9) ------------------------------------------------------------------------------------------------------------- */

#include "../paper/_shares_call.h"

/* --- the module ---------------------------------------------------------------------------------------------------------- */

static PyMethodDef METHODS[] = {
    {"solve", solve_problems, METH_VARARGS,
     "solve(level, kind, paths, most_steps, relative, first_damping, harmonics, re, im, weights, starts, worth, points, cost, "
     "matrix, converged, steps)\n\n"
     "Minimise every problem from its start. Everybody but the tests calls it through compiled.py."},
    {"scan", scan_pixels, METH_VARARGS,
     "scan(level, rows, places, pairs, factors, lags, re, im, first, lag, peak, other)\n\n"
     "Find the path or pair of a grid of delays that explains most. Everybody but the tests calls it through compiled.py."},
    {"weigh", weigh_pixels, METH_VARARGS,
     "weigh(level, paths, harmonics, noise, points, weights)\n\n"
     "Find the weights that the noise of the light of some paths gives. Everybody but the tests calls it through compiled.py."},
    {"shares", search_shares, METH_VARARGS,
     "shares(level, first_start, last_start, most_steps, key, relative, absolute, first_damping, harmonics, re, im, places, z, cost, "
     "converged, steps)\n\n"
     "Search the shares of two paths by Eq. (9). Everybody but the tests calls it through resolver/paper/search.py."},
    LEVELS_METHOD,
    {NULL, NULL, 0, NULL}};

static struct PyModuleDef MODULE = {.m_base = PyModuleDef_HEAD_INIT,
                                    .m_name = "_search",
                                    .m_doc = "Levenberg–Marquardt for many small problems, compiled.",
                                    .m_methods = METHODS,
                                    .m_slots = SLOTS};

PyMODINIT_FUNC PyInit__search(void) { return PyModuleDef_Init(&MODULE); }
