/* Light between surfaces as Python calls it: buffers in, buffers filled; a part of _kernel.c, see radiosity.py. */
enum { FACING, PAIR_AREA, OVER, SQUARE, PAIR_BUFFERS };
static const Wanted PAIR_BUFFER[PAIR_BUFFERS] = {
    {"facing", "f ", 0, 0, 0}, {"area", "f ", 0, 0, 0}, {"form factors", "f ", 0, 0, 1}, {"phases", "f ", 0, 0, 1}};

static PyObject *form_factors_checked(const Level *level, const void *options, const Py_buffer *view) {
    const float rad_per_m = *(const float *)options;
    const int64_t sources = values_in(&view[PAIR_AREA]), onto = sources ? values_in(&view[FACING]) / sources : 0;
    const int64_t pairs = onto * sources, expected[PAIR_BUFFERS] = {pairs, sources, pairs, pairs};
    if (!fit_call(PAIR_BUFFER, view, PAIR_BUFFERS, expected)) return NULL;
    const Pairs all = {view[FACING].buf, view[PAIR_AREA].buf, view[OVER].buf, view[SQUARE].buf, rad_per_m, onto, sources};
    Py_BEGIN_ALLOW_THREADS
    level->form_factors(&all);
    Py_END_ALLOW_THREADS
    Py_RETURN_NONE;
}

static PyObject *form_factors(PyObject *module, PyObject *arguments) {
    (void)module;
    float rad_per_m = 0.0f;
    return with_buffers(arguments, PAIR_BUFFER, PAIR_BUFFERS, form_factors_checked, &rad_per_m, "f", &rad_per_m);
}

enum { FORM, ALBEDO, PAIR_COSINES, PAIR_SINES, KERNEL_OUT, TURN_OUT, KERNEL_BUFFERS };
static const Wanted KERNEL_BUFFER[KERNEL_BUFFERS] = {{"form factors", "f ", 0, 0, 0}, {"albedo", "f ", 0, 0, 0},
                                                     {"cosines", "f ", 0, 0, 0},      {"sines", "f ", 0, 0, 0},
                                                     {"kernel", "Zf ", 0, 0, 1},      {"rotors", "Zf ", 0, 0, 1}};

static PyObject *light_kernel_checked(const Level *level, const void *none, const Py_buffer *view) {
    (void)none;
    const int64_t sources = values_in(&view[ALBEDO]), onto = sources ? values_in(&view[FORM]) / sources : 0;
    const int64_t pairs = onto * sources, expected[KERNEL_BUFFERS] = {pairs, sources, pairs, pairs, pairs, pairs};
    if (!fit_call(KERNEL_BUFFER, view, KERNEL_BUFFERS, expected)) return NULL;
    const LightKernel all = {view[FORM].buf,       view[ALBEDO].buf,   view[PAIR_COSINES].buf, view[PAIR_SINES].buf,
                             view[KERNEL_OUT].buf, view[TURN_OUT].buf, onto,                   sources};
    Py_BEGIN_ALLOW_THREADS
    level->kernel(&all);
    Py_END_ALLOW_THREADS
    Py_RETURN_NONE;
}

static PyObject *light_kernel(PyObject *module, PyObject *arguments) {
    (void)module;
    return with_buffers(arguments, KERNEL_BUFFER, KERNEL_BUFFERS, light_kernel_checked, NULL, "");
}
