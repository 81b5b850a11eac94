/* The call of `follow_pairs` from Python: checks the buffers and fills one. A part of _kernel.c, see other_pairs.py. */
enum { FOLLOW_SHARED, FOLLOW_TABLES, FOLLOW_PHASES, FOLLOW_PHASORS, FOLLOW_WEIGHTS, FOLLOW_FOUND, FOLLOW_SIGMA, FOLLOW_FARTHEST,
       FOLLOW_BUFFERS };
static const Wanted FOLLOW_BUFFER[FOLLOW_BUFFERS] = {
    {"constants", FLOATS, READ}, {"tables", FLOATS, READ}, {"phases", FLOATS, MAY_BE_NONE}, {"phasors", FLOATS, READ},
    {"per variance", FLOATS, READ}, {"found", FLOATS, READ}, {"sigma", FLOATS, READ}, {"farthest", FLOATS, WRITE},
};

static PyObject *follow_checked(const Level *level, const void *none, const Py_buffer *view) {
    (void)none;
    const Py_ssize_t pixels = values_in(&view[FOLLOW_WEIGHTS]), rows = values_in(&view[FOLLOW_TABLES]) / (4 * ENTRIES);
    if (!are_pixels(pixels)) return NULL;
    if (rows < 2 || rows > MOST_ROWS)
        return PyErr_Format(PyExc_ValueError, "found tables of %zd harmonics, expected 2 to %d", rows, MOST_ROWS);
    const int64_t expected[FOLLOW_BUFFERS] = {
        FOLLOW_CONSTANTS + 3 * rows, 4 * ENTRIES * rows, rows * pixels, 2 * rows * pixels, pixels, 2 * pixels, 2 * pixels, 2 * pixels};
    if (!fit_call(FOLLOW_BUFFER, view, FOLLOW_BUFFERS, expected)) return NULL;
    const Follow follow = {
        .constants = view[FOLLOW_SHARED].buf,
        .tables = view[FOLLOW_TABLES].buf,
        .phase_rad = view[FOLLOW_PHASES].buf,
        .phasor = view[FOLLOW_PHASORS].buf,
        .per_variance = view[FOLLOW_WEIGHTS].buf,
        .found = view[FOLLOW_FOUND].buf,
        .sigma = view[FOLLOW_SIGMA].buf,
        .farthest = view[FOLLOW_FARTHEST].buf,
        .pixels = pixels,
        .rows = (int)rows,
    };
    RETURN_AFTER(level->follow(&follow));
}

CALL_OF_BUFFERS(follow_pairs_of, FOLLOW_BUFFER, FOLLOW_BUFFERS, follow_checked)
