/* The call of the search from Python: checks the buffers and fills them. A part of _kernel.c, see newton.py. */
enum { SEARCH_SHARED, TABLE_1, TABLE_2, OWN_PHASES, OBSERVED, ENOUGH, START, VALUES, MISFIT, DONE, SEARCH_BUFFERS };
static const Wanted SEARCH_BUFFER[SEARCH_BUFFERS] = {
    {"search constants", FLOATS, READ}, {"first table", FLOATS, READ}, {"second table", FLOATS, READ},
    {"phases", FLOATS, MAY_BE_NONE}, {"observed", FLOATS, READ}, {"enough", FLOATS, READ}, {"start", FLOATS, READ},
    {"values", FLOATS, WRITE}, {"misfit", FLOATS, WRITE}, {"done", BOOLS, WRITE},
};

static PyObject *search_checked(const Level *level, const void *options, const Py_buffer *view) {
    const int steps = *(const int *)options;
    const Py_ssize_t pixels = values_in(&view[DONE]);
    if (steps < 0 || steps > MOST_STEPS) return PyErr_Format(PyExc_ValueError, "found %d steps, expected 0 to %d", steps, MOST_STEPS);
    if (!are_pixels(pixels)) return NULL;
    const int64_t expected[SEARCH_BUFFERS] = {
        SEARCH_CONSTANTS, 4 * ENTRIES, 4 * ENTRIES, 2 * pixels, 4 * pixels, pixels, 4 * pixels, 4 * pixels, pixels, pixels};
    if (!fit_call(SEARCH_BUFFER, view, SEARCH_BUFFERS, expected)) return NULL;
    const Search search = {
        .constants = view[SEARCH_SHARED].buf,
        .table = {view[TABLE_1].buf, view[TABLE_2].buf},
        .phase_rad = view[OWN_PHASES].buf,
        .observed = view[OBSERVED].buf,
        .enough = view[ENOUGH].buf,
        .start = view[START].buf,
        .values = view[VALUES].buf,
        .misfit = view[MISFIT].buf,
        .done = view[DONE].buf,
        .pixels = pixels,
        .steps = steps,
    };
    RETURN_AFTER(level->search(&search));
}

static PyObject *search(PyObject *module, PyObject *arguments) {
    (void)module;
    int steps = 0;
    return with_buffers(arguments, SEARCH_BUFFER, SEARCH_BUFFERS, search_checked, &steps, "i", &steps);
}
