/* The call of `follow_pairs` from Python: checks the buffers and fills one. A part of _kernel.c, see other_pairs.py. */
enum { FOLLOW_SHARED, FOLLOW_TABLE_1, FOLLOW_TABLE_2, FOLLOW_PHASES, FOLLOW_PHASORS, FOLLOW_WEIGHTS, FOLLOW_FOUND, FOLLOW_SIGMA, FOLLOW_FARTHEST, FOLLOW_BUFFERS };
static const Wanted FOLLOW_BUFFER[FOLLOW_BUFFERS] = {
    {"constants", FLOATS, READ}, {"first table", FLOATS, READ}, {"second table", FLOATS, READ},
    {"phases", FLOATS, MAY_BE_NONE}, {"phasors", FLOATS, READ}, {"per variance", FLOATS, READ}, {"found", FLOATS, READ},
    {"sigma", FLOATS, READ}, {"farthest", FLOATS, WRITE},
};

static PyObject *follow_checked(const Level *level, const void *none, const Py_buffer *view) {
    (void)none;
    const Py_ssize_t pixels = values_in(&view[FOLLOW_WEIGHTS]);
    if (!are_pixels(pixels)) return NULL;
    const int64_t expected[FOLLOW_BUFFERS] = {
        FOLLOW_CONSTANTS, 4 * ENTRIES, 4 * ENTRIES, 2 * pixels, 4 * pixels, pixels, 2 * pixels, 2 * pixels, 2 * pixels};
    if (!fit_call(FOLLOW_BUFFER, view, FOLLOW_BUFFERS, expected)) return NULL;
    const Follow follow = {
        .constants = view[FOLLOW_SHARED].buf,
        .table = {view[FOLLOW_TABLE_1].buf, view[FOLLOW_TABLE_2].buf},
        .phase_rad = view[FOLLOW_PHASES].buf,
        .phasor = view[FOLLOW_PHASORS].buf,
        .per_variance = view[FOLLOW_WEIGHTS].buf,
        .found = view[FOLLOW_FOUND].buf,
        .sigma = view[FOLLOW_SIGMA].buf,
        .farthest = view[FOLLOW_FARTHEST].buf,
        .pixels = pixels,
    };
    RETURN_AFTER(level->follow(&follow));
}

CALL_OF_BUFFERS(follow_pairs_of, FOLLOW_BUFFER, FOLLOW_BUFFERS, follow_checked)
