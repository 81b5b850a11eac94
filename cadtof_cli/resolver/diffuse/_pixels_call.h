/* Pixels answered through a tail as Python calls it: buffers in, buffers filled; a part of _kernel.c, see pixels.py. */
enum { PHASORS_IN, USABLE, POOLED_OVER, ANSWERED, ANSWER_ROWS, ANSWER_TAIL, ANSWER_BUFFERS = ANSWER_TAIL + TAIL_BUFFERS };
static const Wanted ANSWER_BUFFER[ANSWER_BUFFERS] = {
    {"phasors", COMPLEX_DOUBLES, READ}, {"usable", BOOLS, READ}, {"samples", DOUBLES, MAY_BE_NONE},
    {"answered", BOOLS, WRITE}, {"answers", FLOATS, WRITE}, TAIL_WANTED(READ),
};

static PyObject *answer_checked(const Level *level, const void *none, const Py_buffer *view) {
    (void)none;
    const int64_t pixels = values_in(&view[ANSWERED]);
    int64_t expected[ANSWER_BUFFERS] = {0, pixels, pixels, pixels, TAIL_ANSWERS * pixels};
    Tail tail;
    if (!are_pixels(pixels) || !expect_tail(&view[ANSWER_TAIL], pixels, &expected[ANSWER_TAIL])) return NULL;
    expected[PHASORS_IN] = expected[ANSWER_TAIL + NUMBERS] * pixels;
    if (!fit_call(ANSWER_BUFFER, view, ANSWER_BUFFERS, expected) || !make_tail(&tail, &view[ANSWER_TAIL])) return NULL;
    const TailAnswers answers = {
        .tail = &tail,
        .phasors = view[PHASORS_IN].buf,
        .usable = view[USABLE].buf,
        .samples = view[POOLED_OVER].buf,
        .answered = view[ANSWERED].buf,
        .rows = view[ANSWER_ROWS].buf,
        .pixels = pixels,
    };
    RETURN_AFTER(level->answer(&answers));
}

CALL_OF_BUFFERS(answer_tail, ANSWER_BUFFER, ANSWER_BUFFERS, answer_checked)
