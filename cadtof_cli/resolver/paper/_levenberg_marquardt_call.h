/* The call of the search of Eq. (9) from Python: it checks and fills the buffers. A part of _likelihood.c, see levenberg_marquardt.py. */
enum { SHARE_HARMONICS, SHARE_RE, SHARE_IM, PLACES, SHARE_Z, SHARE_COST, SHARE_CONVERGED, SHARE_STEPS, SHARE_BUFFERS };
static const Wanted SHARE_WANTED[SHARE_BUFFERS] = {
    {"harmonics", INT64S, READ}, {"re", DOUBLES, READ}, {"im", DOUBLES, READ}, {"places", INT64S, READ},
    {"z", DOUBLES, WRITE}, {"cost", DOUBLES, WRITE}, {"converged", BOOLS, WRITE}, {"steps", INT64S, WRITE},
};

static PyObject *shares_checked(const Level *level, const void *options, const Py_buffer *view) {
    ShareSearch search = *(const ShareSearch *)options;
    const int64_t count = values_in(&view[SHARE_COST]), rows = values_in(&view[SHARE_HARMONICS]);
    if (search.first_start < 0 || search.last_start <= search.first_start)
        return PyErr_Format(PyExc_ValueError, "found starts %d to %d", search.first_start, search.last_start);
    if (!is_known(WHITE, 1, search.most_steps, &view[SHARE_HARMONICS]) || !are_few(count)) return NULL;
    const int64_t expected[SHARE_BUFFERS] = {rows, rows * count, rows * count, count, 2 * count, count, count, count};
    if (!fit_call(SHARE_WANTED, view, SHARE_BUFFERS, expected)) return NULL;
    search.rows = (int)rows;
    search.count = count;
    search.harmonics = view[SHARE_HARMONICS].buf;
    search.places = view[PLACES].buf;
    search.re = view[SHARE_RE].buf;
    search.im = view[SHARE_IM].buf;
    search.z = view[SHARE_Z].buf;
    search.cost = view[SHARE_COST].buf;
    search.converged = view[SHARE_CONVERGED].buf;
    search.steps = view[SHARE_STEPS].buf;
    RETURN_AFTER(level->shares(&search));
}

static PyObject *search_shares(PyObject *module, PyObject *arguments) {
    (void)module;
    ShareSearch asked = {0};
    return with_buffers(arguments, SHARE_WANTED, SHARE_BUFFERS, shares_checked, &asked, "iiiKddd", &asked.first_start,
                        &asked.last_start, &asked.most_steps, &asked.key, &asked.relative, &asked.absolute, &asked.first_damping);
}
