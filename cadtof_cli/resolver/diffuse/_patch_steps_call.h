/* Slopes of the tail's model and steps of the patch fit as Python calls them: buffers in, buffers filled; a part of _kernel.c, see
 * tail.py and patch_steps.py. */
#define MOST_PATCHES ((Py_ssize_t)1 << 24)

static int is_of_patches(Py_ssize_t patches, Py_ssize_t harmonics) {
    if (patches >= 0 && patches <= MOST_PATCHES && harmonics >= 2 && harmonics <= MOST_HARMONICS) return 1;
    PyErr_Format(PyExc_ValueError, "found %zd patches of %zd harmonics, expected fewer, of 2 to %d", patches, harmonics, MOST_HARMONICS);
    return 0;
}

enum { NUMBER, RAD_PER_NS, ONSET, NATURAL, COSINES, SINES, SEEN, BEYOND, LATER, TOTAL, SLOPES_OUT, SLOPE_BUFFERS };
static const Wanted SLOPE_BUFFER[SLOPE_BUFFERS] = {
    {"numbers", DOUBLES, READ}, {"rad per ns", DOUBLES, READ}, {"onset", DOUBLES, READ}, {"state", DOUBLES, READ},
    {"cosines", DOUBLES, READ}, {"sines", DOUBLES, READ}, {"seen", COMPLEX_DOUBLES, READ},
    {"beyond", COMPLEX_DOUBLES, READ}, {"later", COMPLEX_DOUBLES, READ}, {"total", DOUBLES, WRITE},
    {"slopes", DOUBLES, WRITE},
};

static PyObject *slopes_checked(const Level *level, const void *none, const Py_buffer *view) {
    (void)none;
    const int64_t patches = values_in(&view[NATURAL]) / 5, harmonics = values_in(&view[NUMBER]);
    if (!is_of_patches(patches, harmonics)) return NULL;
    const int64_t all = patches * harmonics;
    const int64_t expected[SLOPE_BUFFERS] = {harmonics, harmonics, harmonics, 5 * patches, all, all, all, all, all, 3 * all,
                                             2 * STATES * all};
    if (!fit_call(SLOPE_BUFFER, view, SLOPE_BUFFERS, expected)) return NULL;
    const Slopes slopes = {
        .number = view[NUMBER].buf,
        .rad_per_ns = view[RAD_PER_NS].buf,
        .onset = view[ONSET].buf,
        .natural = view[NATURAL].buf,
        .cos = view[COSINES].buf,
        .sin = view[SINES].buf,
        .seen = view[SEEN].buf,
        .beyond = view[BEYOND].buf,
        .later = view[LATER].buf,
        .total = view[TOTAL].buf,
        .jacobian = view[SLOPES_OUT].buf,
        .harmonics = harmonics,
        .patches = patches,
    };
    RETURN_AFTER(level->slopes(&slopes));
}

CALL_OF_BUFFERS(tail_slopes, SLOPE_BUFFER, SLOPE_BUFFERS, slopes_checked)

enum { PATCH_DATA, PATCH_ERROR, WITHIN, PATTERN, PATCH_VALUES, JACOBIAN, STATE, LINEAR, ROOM, SPREAD, STEP_OUT, SECOND_OUT, LAST_OUT, STEP_BUFFERS };
static const Wanted STEP_BUFFER[STEP_BUFFERS] = {
    {"data", DOUBLES, READ}, {"error", DOUBLES, READ}, {"within", DOUBLES, READ}, {"pattern", DOUBLES, READ},
    {"values", DOUBLES, MAY_BE_NONE}, {"slopes", DOUBLES, READ}, {"state", DOUBLES, READ},
    {"linear data", DOUBLES, MAY_BE_NONE}, {"room", DOUBLES, MAY_BE_NONE}, {"spread", DOUBLES, MAY_BE_NONE},
    {"answer", DOUBLES, WRITE}, {"second answer", DOUBLES, MAY_BE_NONE | WRITE},
    {"third answer", DOUBLES, MAY_BE_NONE | WRITE},
};

/* Check that a step has the arrays that it alone needs, and that every array has the right number of values. */
static int step_fits(enum step step, const Py_buffer *view, int64_t data, int64_t patches) {
    const int64_t values = data + 2, square = values * values * patches;
    const int64_t answer[][3] = {
        [EVIDENCE] = {data * (STATES + 1) * patches, data * patches, 0},
        [MOVED] = {STATES * patches, 0, 0},
        [POSTERIOR] = {values * patches, values * patches, square},
    };
    const int needed[][4] = {[EVIDENCE] = {PATCH_VALUES, SECOND_OUT, STEP_OUT, STEP_OUT}, [MOVED] = {LINEAR, ROOM, SPREAD, STEP_OUT},
                             [POSTERIOR] = {PATCH_VALUES, ROOM, SPREAD, SECOND_OUT}};
    for (int which = 0; which < 4; which++)
        if (!view[needed[step][which]].obj || (step == POSTERIOR && !view[LAST_OUT].obj)) {
            PyErr_SetString(PyExc_ValueError, "found None, expected all that the step needs");
            return 0;
        }
    const int64_t expected[STEP_BUFFERS] = {
        data * patches, square, STATES, STATES * patches, values * patches, STATES * values * patches, STATES * patches,
        data * patches, STATES, STATES * STATES, answer[step][0], answer[step][1], answer[step][2]};
    return fit_call(STEP_BUFFER, view, STEP_BUFFERS, expected);
}

static PyObject *step_checked(const Level *level, const void *options, const Py_buffer *view) {
    const int asked = *(const int *)options;
    if (asked < EVIDENCE || asked > POSTERIOR) return PyErr_Format(PyExc_ValueError, "found step %d, expected 0, 1 or 2", asked);
    const enum step step = (enum step)asked;
    const int64_t patches = values_in(&view[PATTERN]) / STATES, data = patches ? values_in(&view[PATCH_DATA]) / patches : 2;
    if (!is_of_patches(patches, data / 2 + 1) || !step_fits(step, view, data / 2 * 2, patches)) return NULL;
    const Steps steps = {
        .step = step,
        .data = view[PATCH_DATA].buf,
        .error = view[PATCH_ERROR].buf,
        .within = view[WITHIN].buf,
        .pattern = view[PATTERN].buf,
        .values = view[PATCH_VALUES].buf,
        .jacobian = view[JACOBIAN].buf,
        .state = view[STATE].buf,
        .linear = view[LINEAR].buf,
        .room = view[ROOM].buf,
        .spread = view[SPREAD].buf,
        .answer = view[STEP_OUT].buf,
        .second = view[SECOND_OUT].buf,
        .third = view[LAST_OUT].buf,
        .harmonics = data / 2 + 1,
        .patches = patches,
    };
    RETURN_AFTER(level->step(&steps));
}

static PyObject *step_patches(PyObject *module, PyObject *arguments) {
    (void)module;
    int step = 0;
    return with_buffers(arguments, STEP_BUFFER, STEP_BUFFERS, step_checked, &step, "i", &step);
}
