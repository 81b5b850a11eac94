/* The compiled twins of levenberg_marquardt.py, of the scans in starts.py, of the equations in response/more_harmonics.py,
 * and of the search of Eq. (9) (paper/levenberg_marquardt.py), as a Python module. Each function reads buffers and fills
 * buffers; the module keeps no state.
 *
 * These modules and mixture.py are its Python fronts. The buffers are checked here again: a buffer of the wrong type,
 * size, alignment or layout raises ValueError or TypeError and never crashes.
 */
#ifndef Py_GIL_DISABLED
#define Py_LIMITED_API 0x030b0000 /* one build for every Python from 3.11 on */
#endif
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include "../_instruction_sets.h"
#include "_levenberg_marquardt.h"
#include "_starts.h"
#include "../paper/_levenberg_marquardt.h"
#include "../_buffers.h"

#define WORK(X, name, attributes) \
    X(search, search_all, Search, name, attributes) \
    X(scan, scan_all, Scan, name, attributes) \
    X(weigh, weigh_all, Weigh, name, attributes) \
    X(shares, share_all, ShareSearch, name, attributes)
#include "../_module.h"
#include "../_calls.h"

/* --- the search ---------------------------------------------------------------------------------------------------------- */

enum { HARMONICS, RE, IM, WEIGHTS, STARTS, WORTH, POINTS, COST, MATRIX, CONVERGED, TABLES, OWN_RAD, OWN_ROTORS, BUFFERS };
static const Wanted WANTED[BUFFERS] = {
    {"harmonics", INT64S, READ}, {"re", DOUBLES, READ}, {"im", DOUBLES, READ}, {"weights", DOUBLES, READ},
    {"starts", DOUBLES, READ}, {"worth", DOUBLES, READ}, {"points", DOUBLES, WRITE}, {"cost", DOUBLES, WRITE},
    {"matrix", DOUBLES, WRITE}, {"converged", BOOLS, WRITE}, {"tables", FLOATS, MAY_BE_NONE}, {"own_rad", FLOATS, MAY_BE_NONE},
    {"own_rotors", COMPLEX_DOUBLES, MAY_BE_NONE},
};

/* Return 1 if kind, paths, steps and harmonics are within the limits; otherwise set an error and return 0. */
static int is_known(int kind, int paths, int most_steps, const Py_buffer *harmonics) {
    const Py_ssize_t rows = values_in(harmonics);
    if (kind < WHITE || kind > RESPONSE || paths < 1 || paths > MOST_PATHS || most_steps < 0 || rows < 1 ||
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

/* Return 1 if the number of pixels is small enough for the arrays; otherwise set an error and return 0. */
static int are_few(int64_t count) {
    if (count <= PY_SSIZE_T_MAX / 4096) return 1;
    PyErr_Format(PyExc_ValueError, "found %lld pixels, expected fewer", (long long)count);
    return 0;
}

static PyObject *solve_checked(const Level *level, const void *options, const Py_buffer *view) {
    Search search = *(const Search *)options;
    const int64_t count = values_in(&view[COST]), rows = values_in(&view[HARMONICS]);
    if (!is_known(search.kind, search.paths, search.most_steps, &view[HARMONICS]) || !are_few(count)) return NULL;
    if ((search.kind == RESPONSE) != !!view[TABLES].obj || !view[OWN_RAD].obj != !view[OWN_ROTORS].obj ||
        (view[OWN_RAD].obj && search.kind != RESPONSE)) {
        PyErr_SetString(PyExc_ValueError, "tables: expected for a response alone; and own_rad and own_rotors together");
        return NULL;
    }
    const int64_t points = 3 * search.paths * count;
    const int64_t expected[BUFFERS] = {
        rows,  rows * count, rows * count, search.kind == WHITE ? rows : 3 * rows * count, points, count, points,
        count, ENTRY(2 * search.paths, 0) * count, count, 4 * ENTRIES * rows, rows * count, rows * count};
    if (!fit_call(WANTED, view, BUFFERS, expected)) return NULL;
    search.rows = (int)rows;
    search.count = count;
    search.harmonics = view[HARMONICS].buf;
    search.re = view[RE].buf;
    search.im = view[IM].buf;
    search.weights = view[WEIGHTS].buf;
    search.starts = view[STARTS].buf;
    search.worth = view[WORTH].buf;
    search.points = view[POINTS].buf;
    search.cost = view[COST].buf;
    search.matrix = view[MATRIX].buf;
    search.converged = view[CONVERGED].buf;
    search.tables = view[TABLES].buf;
    search.own_rad = view[OWN_RAD].buf;
    search.own_rotors = view[OWN_ROTORS].buf;
    RETURN_AFTER(level->search(&search));
}

static PyObject *solve_problems(PyObject *module, PyObject *arguments) {
    (void)module;
    Search asked = {0};
    return with_buffers(arguments, WANTED, BUFFERS, solve_checked, &asked, "iiidd", &asked.kind, &asked.paths, &asked.most_steps,
                        &asked.relative, &asked.first_damping);
}

/* --- the weights --------------------------------------------------------------------------------------------------------- */

enum { WEIGH_HARMONICS, NOISE, WEIGH_POINTS, WEIGH_WEIGHTS, WEIGH_BUFFERS };
static const Wanted WEIGH_WANTED[WEIGH_BUFFERS] = {
    {"harmonics", INT64S, READ}, {"noise", DOUBLES, READ}, {"points", DOUBLES, READ}, {"weights", DOUBLES, WRITE},
};

static PyObject *weigh_checked(const Level *level, const void *options, const Py_buffer *view) {
    const int paths = *(const int *)options;
    if (!is_known(WEIGHTED, paths, 0, &view[WEIGH_HARMONICS])) return NULL;
    const int64_t rows = values_in(&view[WEIGH_HARMONICS]), count = values_in(&view[WEIGH_POINTS]) / (3 * paths);
    const int64_t expected[WEIGH_BUFFERS] = {rows, 3 * rows, 3 * paths * count, 3 * rows * count};
    if (!are_few(count) || !fit_call(WEIGH_WANTED, view, WEIGH_BUFFERS, expected)) return NULL;
    const Weigh weigh = {paths, (int)rows, count, view[WEIGH_HARMONICS].buf, view[NOISE].buf, view[WEIGH_POINTS].buf,
                         view[WEIGH_WEIGHTS].buf};
    RETURN_AFTER(level->weigh(&weigh));
}

static PyObject *weigh_pixels(PyObject *module, PyObject *arguments) {
    (void)module;
    int paths = 0;
    return with_buffers(arguments, WEIGH_WANTED, WEIGH_BUFFERS, weigh_checked, &paths, "i", &paths);
}

/* --- the scan ------------------------------------------------------------------------------------------------------------ */

enum { FACTORS, LAGS, SCAN_RE, SCAN_IM, FIRST, LAG, PEAK, OTHER, SCAN_BUFFERS };
static const Wanted SCAN_WANTED[SCAN_BUFFERS] = {
    {"factors", DOUBLES, READ}, {"lags", DOUBLES, READ}, {"re", DOUBLES, READ}, {"im", DOUBLES, READ},
    {"first", INT64S, WRITE}, {"lag", INT64S, WRITE}, {"peak", DOUBLES, WRITE}, {"other", DOUBLES, WRITE},
};

static PyObject *scan_checked(const Level *level, const void *options, const Py_buffer *view) {
    Scan scan = *(const Scan *)options;
    const int64_t count = values_in(&view[FIRST]), rows = scan.rows, places = scan.places;
    if (rows < 1 || rows > MOST_ROWS || places < 2 || places > MOST_PLACES)
        return PyErr_Format(PyExc_ValueError, "found %d harmonics and %d places", scan.rows, scan.places);
    const int64_t expected[SCAN_BUFFERS] = {2 * rows * places, 3 * (places / 2), rows * count, rows * count, count, count, count, count};
    if (!are_few(count) || !fit_call(SCAN_WANTED, view, SCAN_BUFFERS, expected)) return NULL;
    scan.count = count;
    scan.factors = view[FACTORS].buf;
    scan.lags = view[LAGS].buf;
    scan.re = view[SCAN_RE].buf;
    scan.im = view[SCAN_IM].buf;
    scan.first = view[FIRST].buf;
    scan.lag = view[LAG].buf;
    scan.peak = view[PEAK].buf;
    scan.other = view[OTHER].buf;
    RETURN_AFTER(level->scan(&scan));
}

static PyObject *scan_pixels(PyObject *module, PyObject *arguments) {
    (void)module;
    Scan asked = {0};
    return with_buffers(arguments, SCAN_WANTED, SCAN_BUFFERS, scan_checked, &asked, "iip", &asked.rows, &asked.places, &asked.pairs);
}

/* --- Eq. (9) ------------------------------------------------------------------------------------------------------------- */

#include "../paper/_levenberg_marquardt_call.h"

/* --- the module ---------------------------------------------------------------------------------------------------------- */

static PyMethodDef METHODS[] = {
    {"solve", solve_problems, METH_VARARGS,
     "solve(level, kind, paths, most_steps, relative, first_damping, harmonics, re, im, weights, starts, worth, points, cost, "
     "matrix, converged, tables, own_rad, own_rotors)\n\n"
     "Minimise every problem from its start. Everybody but the tests calls it through levenberg_marquardt.py."},
    {"scan", scan_pixels, METH_VARARGS,
     "scan(level, rows, places, pairs, factors, lags, re, im, first, lag, peak, other)\n\n"
     "Find the path or pair of a grid of delays that explains most. Everybody but the tests calls it through starts.py."},
    {"weigh", weigh_pixels, METH_VARARGS,
     "weigh(level, paths, harmonics, noise, points, weights)\n\n"
     "Find the weights that the noise of the light of some paths gives. Everybody but the tests calls it through mixture.py."},
    {"shares", search_shares, METH_VARARGS,
     "shares(level, first_start, last_start, most_steps, key, relative, absolute, first_damping, harmonics, re, im, places, z, cost, "
     "converged, steps)\n\n"
     "Search the shares of two paths by Eq. (9). Everybody but the tests calls it through resolver/paper/levenberg_marquardt.py."},
    LEVELS_METHOD,
    {NULL, NULL, 0, NULL}};

static struct PyModuleDef MODULE = {.m_base = PyModuleDef_HEAD_INIT,
                                    .m_name = "_likelihood",
                                    .m_doc = "Levenberg–Marquardt for many small problems, compiled.",
                                    .m_methods = METHODS,
                                    .m_slots = SLOTS};

PyMODINIT_FUNC PyInit__likelihood(void) { return PyModuleDef_Init(&MODULE); }
