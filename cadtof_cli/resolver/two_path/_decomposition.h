/* The call from Python that decomposes given phasors into two paths: checks the buffers and fills them. A part of
 * _kernel.c, see decomposition.py. */
enum { FIRST_PHASOR, SECOND_PHASOR, DECOMPOSITION, DECOMPOSED_BUFFERS };
static const Wanted DECOMPOSED_BUFFER[DECOMPOSED_BUFFERS] = {
    {"first phasors", COMPLEX_DOUBLES, READ}, {"second phasors", COMPLEX_DOUBLES, READ}, {"paths", DOUBLES, WRITE},
};

static PyObject *decompose_checked(const Level *level, const void *none, const Py_buffer *view) {
    (void)none;
    const Py_ssize_t pixels = values_in(&view[FIRST_PHASOR]);
    if (!are_pixels(pixels)) return NULL;
    const int64_t expected[DECOMPOSED_BUFFERS] = {pixels, pixels, DECOMPOSED_PLANES * (int64_t)pixels};
    if (!fit_call(DECOMPOSED_BUFFER, view, DECOMPOSED_BUFFERS, expected)) return NULL;
    const Decomposed decomposed = {view[FIRST_PHASOR].buf, view[SECOND_PHASOR].buf, view[DECOMPOSITION].buf, pixels};
    RETURN_AFTER(level->decompose(&decomposed));
}

CALL_OF_BUFFERS(decompose, DECOMPOSED_BUFFER, DECOMPOSED_BUFFERS, decompose_checked)
