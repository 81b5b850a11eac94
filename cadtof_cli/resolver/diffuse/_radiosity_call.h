/* Light between surfaces as Python calls it: buffers in, buffers filled; a part of _kernel.c, see radiosity.py. */
enum { FACING, PAIR_SQUARE, PAIR_AREA, ALBEDO, OVER, MATRIX_OUT, TURN_OUT, PAIR_BUFFERS };
static const Wanted PAIR_BUFFER[PAIR_BUFFERS] = {
    {"facing", FLOATS, READ}, {"squares", FLOATS, READ}, {"area", FLOATS, READ}, {"albedo", FLOATS, READ},
    {"form factors", FLOATS, WRITE}, {"matrix", COMPLEX_FLOATS, WRITE}, {"rotors", COMPLEX_FLOATS, WRITE},
};

static PyObject *light_matrix_checked(const Level *level, const void *options, const Py_buffer *view) {
    const float rad_per_m = *(const float *)options;
    const int64_t sources = values_in(&view[PAIR_AREA]), onto = sources ? values_in(&view[FACING]) / sources : 0;
    const int64_t pairs = onto * sources, expected[PAIR_BUFFERS] = {pairs, pairs, sources, sources, pairs, pairs, pairs};
    if (!fit_call(PAIR_BUFFER, view, PAIR_BUFFERS, expected)) return NULL;
    const Pairs all = {view[FACING].buf, view[PAIR_SQUARE].buf, view[PAIR_AREA].buf, view[ALBEDO].buf, view[OVER].buf,
                       view[MATRIX_OUT].buf, view[TURN_OUT].buf, rad_per_m, onto, sources};
    RETURN_AFTER(level->matrix(&all));
}

static PyObject *light_matrix(PyObject *module, PyObject *arguments) {
    (void)module;
    float rad_per_m = 0.0f;
    return with_buffers(arguments, PAIR_BUFFER, PAIR_BUFFERS, light_matrix_checked, &rad_per_m, "f", &rad_per_m);
}
