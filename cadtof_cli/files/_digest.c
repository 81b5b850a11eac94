/* The compiled twin of `numpy_sums` in digest.py: one pass over bytes that are still in the cache. */
#ifndef Py_GIL_DISABLED
#define Py_LIMITED_API 0x030b0000 /* one build for every Python from 3.11 on */
#endif
#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <stdint.h>
#include <string.h>
#ifdef _MSC_VER
#define restrict __restrict
#endif

#define WORDS 512 /* of 8 bytes, a row */

/* Bytes need not be aligned: a file's pixels begin wherever its header ends. */
static void sum_rows(const char *restrict data, uint64_t *restrict columns, uint64_t *restrict rows, Py_ssize_t count) {
    for (Py_ssize_t row = 0; row < count; row++, data += 8 * WORDS) {
        uint64_t sum = 0;
        for (int i = 0; i < WORDS; i++) {
            uint64_t word;
            memcpy(&word, data + 8 * i, sizeof word);
            columns[i] += word;
            sum += word;
        }
        rows[row] = sum;
    }
}

static int fits(const Py_buffer *data, const Py_buffer *columns, const Py_buffer *rows) {
    if (columns->len != 8 * WORDS || rows->len % 8 || data->len / (8 * WORDS) != rows->len / 8 || data->len % (8 * WORDS)) {
        PyErr_SetString(PyExc_ValueError, "found buffers that do not fit, expected whole rows, 512 columns and a sum for each row");
        return 0;
    }
    if ((uintptr_t)columns->buf % 8 || (uintptr_t)rows->buf % 8) {
        PyErr_SetString(PyExc_ValueError, "sums are not aligned in memory");
        return 0;
    }
    return 1;
}

static PyObject *sums(PyObject *module, PyObject *arguments) {
    (void)module;
    Py_buffer data, columns, rows;
    if (!PyArg_ParseTuple(arguments, "y*w*w*", &data, &columns, &rows)) return NULL;
    const int fit = fits(&data, &columns, &rows);
    if (fit) {
        Py_BEGIN_ALLOW_THREADS
        sum_rows(data.buf, columns.buf, rows.buf, rows.len / 8);
        Py_END_ALLOW_THREADS
    }
    PyBuffer_Release(&data);
    PyBuffer_Release(&columns);
    PyBuffer_Release(&rows);
    return fit ? Py_NewRef(Py_None) : NULL;
}

static PyMethodDef METHODS[] = {{"sums", sums, METH_VARARGS,
                                 "sums(data, columns, rows)\n\nAdd rows of 512 words to columns, and write the sum of each row."},
                                {NULL, NULL, 0, NULL}};

static PyModuleDef_Slot SLOTS[] = {
#ifdef Py_mod_gil
    {Py_mod_gil, Py_MOD_GIL_NOT_USED},
#endif
    {0, NULL}};

static struct PyModuleDef MODULE = {.m_base = PyModuleDef_HEAD_INIT,
                                    .m_name = "_digest",
                                    .m_doc = "Sums of words, compiled.",
                                    .m_methods = METHODS,
                                    .m_slots = SLOTS};

PyMODINIT_FUNC PyInit__digest(void) { return PyModuleDef_Init(&MODULE); }
