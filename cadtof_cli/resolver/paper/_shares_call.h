/* The search of Eq. (9) as Python calls it: buffers in, buffers filled; a part of _search.c, see search.py. */
enum { SHARE_HARMONICS, SHARE_RE, SHARE_IM, PLACES, SHARE_Z, SHARE_COST, SHARE_CONVERGED, SHARE_STEPS, SHARE_BUFFERS };
static const Wanted SHARE_WANTED[SHARE_BUFFERS] = {
    {"harmonics", "q l ", 8, 0, 0}, {"re", "d ", 8, 0, 0},   {"im", "d ", 8, 0, 0},        {"places", "q l ", 8, 0, 0},
    {"z", "d ", 8, 0, 1},           {"cost", "d ", 8, 0, 1}, {"converged", "? ", 1, 0, 1}, {"steps", "q l ", 8, 0, 1},
};

/* Whether all buffers fit as many pixels as `cost` has; or set an error. */
static int shares_fit(int first_start, int last_start, int most_steps, const Py_buffer *view) {
    const int64_t count = values_in(&view[SHARE_COST]), rows = values_in(&view[SHARE_HARMONICS]);
    if (first_start < 0 || last_start <= first_start || count > PY_SSIZE_T_MAX / 4096) {
        PyErr_Format(PyExc_ValueError, "found starts %d to %d of %lld pixels", first_start, last_start, (long long)count);
        return 0;
    }
    if (!is_known(WHITE, 1, most_steps, &view[SHARE_HARMONICS])) return 0;
    const int64_t values[SHARE_BUFFERS] = {rows, rows * count, rows * count, count, 2 * count, count, count, count};
    for (int which = 0; which < SHARE_BUFFERS; which++)
        if (!has_values(SHARE_WANTED[which].name, &view[which], values[which]) ||
            (SHARE_WANTED[which].writable && !lies_apart(&view[which], SHARE_WANTED, view, SHARE_BUFFERS)))
            return 0;
    return 1;
}

static PyObject *search_shares(PyObject *module, PyObject *arguments) {
    (void)module;
    const char *name;
    int first_start, last_start, most_steps;
    unsigned long long key;
    double relative, absolute, first_damping;
    PyObject *object[SHARE_BUFFERS];
    if (!PyArg_ParseTuple(arguments, "siiiKdddOOOOOOOO", &name, &first_start, &last_start, &most_steps, &key, &relative, &absolute,
                          &first_damping, &object[0], &object[1], &object[2], &object[3], &object[4], &object[5], &object[6],
                          &object[7]))
        return NULL;
    const Level *level = find_level(name);
    if (!level) return NULL;
    Py_buffer view[SHARE_BUFFERS];
    memset(view, 0, sizeof view);
    const int sound = get_buffers(SHARE_WANTED, SHARE_BUFFERS, object, view) && shares_fit(first_start, last_start, most_steps, view);
    if (sound) {
        const ShareSearch search = {
            .rows = (int)values_in(&view[SHARE_HARMONICS]),
            .most_steps = most_steps,
            .first_start = first_start,
            .last_start = last_start,
            .count = values_in(&view[SHARE_COST]),
            .key = key,
            .relative = relative,
            .absolute = absolute,
            .first_damping = first_damping,
            .harmonics = view[SHARE_HARMONICS].buf,
            .places = view[PLACES].buf,
            .re = view[SHARE_RE].buf,
            .im = view[SHARE_IM].buf,
            .z = view[SHARE_Z].buf,
            .cost = view[SHARE_COST].buf,
            .converged = view[SHARE_CONVERGED].buf,
            .steps = view[SHARE_STEPS].buf,
        };
        Py_BEGIN_ALLOW_THREADS
        level->shares(&search);
        Py_END_ALLOW_THREADS
    }
    release_buffers(view, SHARE_BUFFERS);
    if (!sound) return NULL;
    Py_RETURN_NONE;
}
