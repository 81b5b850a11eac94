/* Two paths of phasors that are known, as Python calls it: buffers in, buffers filled; a part of _kernel.c, see decomposition.py. */
enum { FIRST_PHASOR, SECOND_PHASOR, DECOMPOSITION, DECOMPOSED_BUFFERS };
static const Wanted DECOMPOSED_BUFFER[DECOMPOSED_BUFFERS] = {
    {"first phasors", "Zd ", 0, 0, 0}, {"second phasors", "Zd ", 0, 0, 0}, {"paths", "d ", 0, 0, 1}};

static PyObject *decompose(PyObject *module, PyObject *arguments) {
    (void)module;
    const char *name;
    PyObject *object[DECOMPOSED_BUFFERS];
    if (!PyArg_ParseTuple(arguments, "sOOO", &name, &object[0], &object[1], &object[2])) return NULL;
    const Level *level = find_level(name);
    if (!level) return NULL;
    Py_buffer view[DECOMPOSED_BUFFERS];
    memset(view, 0, sizeof view);
    PyObject *result = NULL;
    if (get_buffers(DECOMPOSED_BUFFER, DECOMPOSED_BUFFERS, object, view)) {
        const Py_ssize_t pixels = values_in(&view[FIRST_PHASOR]);
        const int64_t values[DECOMPOSED_BUFFERS] = {1, 1, DECOMPOSED_PLANES};
        int fits = is_part(0, pixels, pixels) && lies_apart(&view[DECOMPOSITION], DECOMPOSED_BUFFER, view, DECOMPOSED_BUFFERS);
        for (int which = 0; fits && which < DECOMPOSED_BUFFERS; which++)
            fits = has_values(DECOMPOSED_BUFFER[which].name, &view[which], values[which] * (int64_t)pixels);
        if (fits) {
            Py_BEGIN_ALLOW_THREADS
            level->decompose(view[FIRST_PHASOR].buf, view[SECOND_PHASOR].buf, view[DECOMPOSITION].buf, pixels);
            Py_END_ALLOW_THREADS
            result = Py_NewRef(Py_None);
        }
    }
    release_buffers(view, DECOMPOSED_BUFFERS);
    return result;
}
