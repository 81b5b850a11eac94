/* The first look at a frame as Python calls it: buffers in, buffers filled; a part of _kernel.c, see light.py. */
#define MOST_SAMPLES ((int64_t)1 << 40)

enum { LOOK_SHARED, LOOK_NUMBERS, PER_VARIANCE, PLACES, LOOK_STORED, LOOK_OWN, LOOK_OTHER, LOOK_CONSTANT, HOT, LOOK_SAMPLES,
       WEIGHTED, PHASES_OUT, SEEN_OUT, LOOK_BUFFERS };
static const Wanted LOOK_BUFFER[LOOK_BUFFERS] = {
    {"constants", DOUBLES, READ}, {"numbers", INT64S, READ}, {"per variance", DOUBLES, READ}, {"places", INT64S, READ},
    {"stored", "H h f d ", 0, READ}, {"own", DOUBLES, READ}, {"other", DOUBLES, MAY_BE_NONE},
    {"constant", DOUBLES, MAY_BE_NONE}, {"hot", BOOLS, MAY_BE_NONE}, {"samples", DOUBLES, MAY_BE_NONE},
    {"weighted", FLOATS, WRITE}, {"phases", FLOATS, WRITE}, {"seen", BOOLS, WRITE},
};

/* Return 1 if every sample is a pixel of the frame or -1, and the numbers of the harmonics ascend from 1; else set an error. */
static int look_is_sound(const int64_t *number, int64_t harmonics, const int64_t *place, int64_t count, int64_t pixels) {
    int sound = ascend(number, harmonics);
    for (int64_t s = 0; s < count; s++) sound &= place[s] >= -1 && place[s] < pixels;
    if (!sound) PyErr_SetString(PyExc_ValueError, "found numbers or places that do not fit, expected those of a frame");
    return sound;
}

static PyObject *look_checked(const Level *level, const void *none, const Py_buffer *view) {
    (void)none;
    const int64_t harmonics = values_in(&view[LOOK_NUMBERS]), count = values_in(&view[PLACES]);
    if (!is_of_patches(0, harmonics)) return NULL;
    const int64_t planes = 2 * harmonics, pixels = values_in(&view[LOOK_STORED]) / planes;
    const int64_t own = values_in(&view[LOOK_OWN]) == planes ? planes : planes * pixels;
    const int64_t expected[LOOK_BUFFERS] = {3, harmonics, harmonics, count, planes * pixels, own, own, own, pixels, pixels,
                                            (1 + planes) * count, count, count};
    if (count > MOST_SAMPLES || !fit_call(LOOK_BUFFER, view, LOOK_BUFFERS, expected)) return NULL;
    if (!pixels) return PyErr_Format(PyExc_ValueError, "stored: found no pixels, expected a frame");
    if (!look_is_sound(view[LOOK_NUMBERS].buf, harmonics, view[PLACES].buf, count, pixels)) return NULL;
    const double *constants = view[LOOK_SHARED].buf;
    const Sampled sampled = {
        .stored = view[LOOK_STORED].buf,
        .own = view[LOOK_OWN].buf,
        .other = view[LOOK_OTHER].buf,
        .constant = view[LOOK_CONSTANT].buf,
        .hot = view[HOT].buf,
        .samples = view[LOOK_SAMPLES].buf,
        .place = view[PLACES].buf,
        .number = view[LOOK_NUMBERS].buf,
        .per_variance = view[PER_VARIANCE].buf,
        .saturated_low = constants[0],
        .saturated_high = constants[1],
        .least_power = constants[2],
        .weighted = view[WEIGHTED].buf,
        .phase_rad = view[PHASES_OUT].buf,
        .seen = view[SEEN_OUT].buf,
        .harmonics = harmonics,
        .pixels = pixels,
        .count = count,
        .type = type_of(&view[LOOK_STORED]),
        .own_pixels = own != planes,
    };
    RETURN_AFTER(level->look(&sampled));
}

CALL_OF_BUFFERS(look_at, LOOK_BUFFER, LOOK_BUFFERS, look_checked)

enum { SUMMED, COUNTED, SUMS_OUT, SUM_BUFFERS };
static const Wanted SUM_BUFFER[SUM_BUFFERS] = {
    {"weighted", FLOATS, READ}, {"counted", BOOLS, READ}, {"sums", DOUBLES, WRITE},
};

static PyObject *sums_checked(const Level *level, const void *none, const Py_buffer *view) {
    (void)none;
    const int64_t each = values_in(&view[COUNTED]), planes = each ? values_in(&view[SUMMED]) / each : 0;
    const int64_t patches = values_in(&view[SUMS_OUT]) / (planes + 1), samples = patches ? each / patches : 0;
    const int64_t expected[SUM_BUFFERS] = {planes * samples * patches, samples * patches, (planes + 1) * patches};
    if (planes > MOST_SUMS) return PyErr_Format(PyExc_ValueError, "weighted: found %lld planes, expected fewer", (long long)planes);
    if (!fit_call(SUM_BUFFER, view, SUM_BUFFERS, expected)) return NULL;
    const Sums sums = {view[SUMMED].buf, view[COUNTED].buf, view[SUMS_OUT].buf, planes, samples, patches};
    RETURN_AFTER(level->sum(&sums));
}

CALL_OF_BUFFERS(sum_over, SUM_BUFFER, SUM_BUFFERS, sums_checked)
