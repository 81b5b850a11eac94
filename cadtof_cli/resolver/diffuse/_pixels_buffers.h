/* A frame's tail as Python hands it over: buffers in the order of TAIL_WANTED, see tail_buffers in pixels.py. Include this
 * after _pixels.h and _buffers.h. */

#define LARGEST_SIDE ((int64_t)1 << 20)
#define LARGEST_NUMBER 1000

#define COUNT_ONE(name) +1
enum { TAIL_SIZE_COUNT = 0 TAIL_SIZES(COUNT_ONE), TAIL_CONSTANT_COUNT = 0 TAIL_CONSTANTS(COUNT_ONE) };
enum { SIZES, SHARED, NUMBERS, VARIANCES, PLANES, RANGES, DOWN, RIGHT, ABOVE, SEPARATE, OFFSET, TAIL_BUFFERS };
/* `role` is MAY_BE_NONE if the call may come without a tail. */
#define TAIL_WANTED(role) \
    {"tail sizes", INT64S, role}, {"tail constants", DOUBLES, role}, {"tail harmonics", INT64S, role}, \
    {"tail variances", DOUBLES, role}, {"tail planes", FLOATS, role}, {"tail ranges", FLOATS, role}, \
    {"tail down", FLOATS, role}, {"tail right", FLOATS, role}, {"tail above", INT64S, role}, \
    {"tail separate", BOOLS, MAY_BE_NONE}, {"tail offset", DOUBLES, MAY_BE_NONE}

static int fails(const char *what) {
    PyErr_Format(PyExc_ValueError, "tail: found %s that do not fit, expected those of a frame", what);
    return 0;
}

/* Return 1 if these are numbers of harmonics: they ascend from 1. */
static int ascend(const int64_t *number, int64_t harmonics) {
    for (int64_t h = 1; h < harmonics; h++)
        if (number[h] <= number[h - 1] || number[h] > LARGEST_NUMBER) return 0;
    return number[0] == 1;
}

/* Return 1 if the pixels lie in the frame and the planes over the patches cover the frame; else set an error. */
static int sizes_fit(const TailSizes *sizes, int64_t pixels) {
    const int64_t side[] = {sizes->height, sizes->width, sizes->side, sizes->rows, sizes->columns};
    for (size_t i = 0; i < sizeof side / sizeof *side; i++)
        if (side[i] < 1 || side[i] > LARGEST_SIDE) return fails("sizes");
    if (sizes->harmonics < 2 || sizes->harmonics > MOST_HARMONICS) return fails("harmonics");
    if (sizes->first < 0 || sizes->first > sizes->height * sizes->width - pixels) return fails("pixels");
    if (sizes->left < 0 || sizes->left > sizes->columns - sizes->width - sizes->side) return fails("columns");
    if ((sizes->height - 1) / sizes->side > sizes->rows - 3) return fails("rows");
    return 1;
}

/* Fill `expected` with the number of values of each buffer of a tail, for `pixels` pixels; or set an error and return 0. */
static int expect_tail(const Py_buffer *view, int64_t pixels, int64_t *expected) {
    for (int which = SIZES; which < SEPARATE; which++)
        if (!view[which].obj) return fails("some buffers");
    if (!has_values("tail sizes", &view[SIZES], TAIL_SIZE_COUNT)) return 0;
    const TailSizes *sizes = view[SIZES].buf;
    if (!sizes_fit(sizes, pixels)) return 0;
    const int64_t plane = sizes->rows * sizes->columns, across = (sizes->width + sizes->side - 1) / sizes->side;
    const int64_t found[TAIL_BUFFERS] = {
        [SIZES] = TAIL_SIZE_COUNT,       [SHARED] = TAIL_CONSTANT_COUNT,
        [NUMBERS] = sizes->harmonics,    [VARIANCES] = sizes->harmonics,
        [PLANES] = planes_of(data_of((int)sizes->harmonics)) * plane,
        [RANGES] = plane,                [DOWN] = sizes->height,
        [RIGHT] = sizes->width,          [ABOVE] = sizes->height,
        [SEPARATE] = (sizes->rows - 2) * across,
        [OFFSET] = sizes->height * sizes->width,
    };
    memcpy(expected, found, sizeof found);
    return 1;
}

/* Fill `tail` from buffers with the expected numbers of values; or set an error and return 0. */
static int make_tail(Tail *tail, const Py_buffer *view) {
    const TailSizes *sizes = view[SIZES].buf;
    const int64_t *number = view[NUMBERS].buf, *above = view[ABOVE].buf;
    if (!ascend(number, sizes->harmonics)) return fails("harmonics");
    for (int64_t y = 0; y < sizes->height; y++)
        if (above[y] < 0 || above[y] > sizes->rows - 2) return fails("rows of patches");
    *tail = (Tail){
        .sizes = sizes,
        .constants = view[SHARED].buf,
        .number = number,
        .variance = view[VARIANCES].buf,
        .planes = view[PLANES].buf,
        .range_m = view[RANGES].buf,
        .down = view[DOWN].buf,
        .right = view[RIGHT].buf,
        .above = above,
        .separate = view[SEPARATE].buf,
        .offset_m = view[OFFSET].buf,
    };
    return 1;
}
