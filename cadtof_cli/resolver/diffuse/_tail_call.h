/* Pixels answered through a tail as Python calls it: buffers in, buffers filled; a part of _kernel.c, see compiled.py. */
enum { PHASORS_IN, USABLE, POOLED_OVER, ANSWERED, ANSWER_ROWS, ANSWER_BUFFERS };
static const Wanted ANSWER_BUFFER[ANSWER_BUFFERS] = {
    {"phasors", "Zd ", 0, 0, 0}, {"usable", "? ", 1, 0, 0},  {"samples", "d ", 0, 1, 0},
    {"answered", "? ", 1, 0, 1}, {"answers", "f ", 0, 0, 1},
};

static PyObject *answer_checked(const Level *level, Py_ssize_t start, Py_ssize_t stop, const Py_buffer *view,
                                const Py_buffer *of_tail) {
    const Py_ssize_t pixels = values_in(&view[ANSWERED]);
    Tail tail;
    if (!is_part(start, stop, pixels) || !make_tail(&tail, of_tail, pixels)) return NULL;
    const int64_t planes[ANSWER_BUFFERS] = {tail.sizes->harmonics, 1, 1, 1, TAIL_ANSWERS};
    for (int which = 0; which < ANSWER_BUFFERS; which++)
        if (!has_values(ANSWER_BUFFER[which].name, &view[which], planes[which] * pixels)) return NULL;
    for (int written = ANSWERED; written < ANSWER_BUFFERS; written++)
        if (!lies_apart(&view[written], ANSWER_BUFFER, view, ANSWER_BUFFERS) ||
            !lies_apart(&view[written], TAIL_BUFFER, of_tail, TAIL_BUFFERS))
            return NULL;
    const TailAnswers answers = {
        .tail = &tail,
        .phasors = view[PHASORS_IN].buf,
        .usable = view[USABLE].buf,
        .samples = view[POOLED_OVER].buf,
        .answered = view[ANSWERED].buf,
        .rows = view[ANSWER_ROWS].buf,
        .pixels = pixels,
    };
    Py_BEGIN_ALLOW_THREADS
    level->answer(&answers, start, stop);
    Py_END_ALLOW_THREADS
    Py_RETURN_NONE;
}

static PyObject *answer_tail(PyObject *module, PyObject *arguments) {
    (void)module;
    const char *name;
    Py_ssize_t start, stop;
    PyObject *object[ANSWER_BUFFERS], *tail;
    if (!PyArg_ParseTuple(arguments, "snnOOOOOO", &name, &start, &stop, &object[0], &object[1], &object[2], &object[3], &object[4],
                          &tail))
        return NULL;
    const Level *level = find_level(name);
    if (!level) return NULL;
    Py_buffer view[ANSWER_BUFFERS], of_tail[TAIL_BUFFERS];
    memset(view, 0, sizeof view);
    memset(of_tail, 0, sizeof of_tail);
    PyObject *result = NULL;
    if (get_buffers(ANSWER_BUFFER, ANSWER_BUFFERS, object, view) && get_tail(tail, of_tail))
        result = answer_checked(level, start, stop, view, of_tail);
    release_buffers(view, ANSWER_BUFFERS);
    release_buffers(of_tail, TAIL_BUFFERS);
    return result;
}
