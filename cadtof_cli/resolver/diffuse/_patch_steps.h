/* What the fit of a frame's patches computes patch by patch: the operations of tail.py and patch_steps.py, in their order. */
#define STATES 6
#define MOST_VALUES (MOST_DATA + 2)
#define LARGEST_STEP 0.8

/* One patch per column. */
typedef struct {
    Row state[STATES], pattern[STATES], pull[STATES];
    Row jacobian[STATES][MOST_VALUES], pushed[STATES][MOST_VALUES];
    Row covariance[MOST_VALUES][MOST_VALUES];
    Row left[MOST_DATA][MOST_DATA], white[MOST_DATA][MOST_VALUES + 1], missed[MOST_DATA], scale;
} PatchGroup;

/* Copy m patches of consecutive rows of n patches into a group. Unused columns of the group repeat the first patch. */
INLINE void take(Row *restrict row, const double *restrict from, int rows, int64_t n, int m) {
    for (int r = 0; r < rows; r++) {
        for (int i = 0; i < m; i++) row[r][i] = from[r * n + i];
        for (int i = m; i < GROUP; i++) row[r][i] = row[r][0];
    }
}

INLINE void give(double *restrict to, const double *restrict row, int m) {
    if (m == GROUP) EACH_PIXEL to[i] = row[i];
    else for (int i = 0; i < m; i++) to[i] = row[i];
}

/* tail.py: wrapped */
INLINE double wrapped_d(double phase) { return phase - FULL_TURN * rint(phase / FULL_TURN); }

/* --- tail.py: TailModel._slopes ------------------------------------------------------------------------------------------- */

typedef struct {
    const double *number, *rad_per_ns, *onset;      /* one per harmonic */
    const double *natural;                          /* s, b, u, v, decay: planes of n patches */
    const double *cos, *sin;                        /* one plane per harmonic */
    const double *seen, *beyond, *later;            /* one plane per harmonic, re and im */
    double *total;                                  /* re, im, squared magnitude: one plane per harmonic each */
    double *jacobian;                               /* states x values */
    int64_t harmonics, patches;
} Slopes;

typedef struct {
    double re, im;
} Number;

INLINE Number times(Number a, Number b) { return (Number){a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re}; }
INLINE Number scaled(double by, const double *part) { return (Number){by * part[0], by * part[1]}; }

INLINE void slopes_of_group(const Slopes *restrict all, int64_t start, int m) {
    const int64_t n = all->patches, harmonics = all->harmonics, values = 2 * harmonics, count = harmonics - 1;
    Row re[STATES], im[STATES], first_re[STATES], first_im[STATES], square, total_re, total_im;
    for (int64_t h = 0; h < harmonics; h++) {
        const double rad_per_ns = all->rad_per_ns[h], onset = all->onset[h], number = all->number[h];
        for (int i = 0; i < m; i++) {
            const int64_t at = start + i, place = h * n + at;
            const double s = all->natural[at], b = all->natural[n + at], u = all->natural[2 * n + at];
            const double v = all->natural[3 * n + at], decay = all->natural[4 * n + at];
            const double turns = rad_per_ns * decay, own = 1.0 / (1.0 + turns * turns), height = onset * (v * decay);
            const Number decayed = {own, turns * own};
            const Number unseen = times((Number){height * all->cos[place], height * all->sin[place]}, decayed);
            const Number seen = scaled(s, all->seen + 2 * place), beyond = scaled(s * b, all->beyond + 2 * place);
            const Number later = scaled(s * s * u, all->later + 2 * place);
            const Number total = {seen.re + beyond.re + later.re + unseen.re + 1.0, seen.im + beyond.im + later.im + unseen.im};
            const double power = total.re * total.re + total.im * total.im;
            const Number inverse = {total.re / power, -total.im / power};
            const Number around = {seen.re + beyond.re + 2.0 * later.re, seen.im + beyond.im + 2.0 * later.im};
            const Number start_ns = {rad_per_ns * -unseen.im, rad_per_ns * unseen.re};
            const Number slope[STATES] = {around, beyond, later, unseen, times(unseen, decayed), start_ns};
            for (int j = 0; j < STATES; j++) {
                const Number of_logarithm = times(slope[j], inverse);
                re[j][i] = of_logarithm.re;
                im[j][i] = of_logarithm.im;
            }
            total_re[i] = total.re;
            total_im[i] = total.im;
            square[i] = power;
        }
        give(all->total + h * n + start, total_re, m);
        give(all->total + (harmonics + h) * n + start, total_im, m);
        give(all->total + (2 * harmonics + h) * n + start, square, m);
        for (int j = 0; j < STATES; j++) {
            double *restrict rows = all->jacobian + j * values * n + start;
            if (h == 0) {
                memcpy(first_re[j], re[j], sizeof re[j]);
                memcpy(first_im[j], im[j], sizeof im[j]);
                give(rows + 2 * count * n, re[j], m);
                give(rows + (2 * count + 1) * n, im[j], m);
            } else {
                double *restrict size = rows + (h - 1) * n, *restrict phase = rows + (count + h - 1) * n;
                for (int i = 0; i < m; i++) size[i] = re[j][i] - first_re[j][i];
                for (int i = 0; i < m; i++) phase[i] = im[j][i] - number * first_im[j][i];
            }
        }
    }
}

INLINE void slopes_of_patches(const Slopes *restrict all) {
    for (int64_t start = 0; start < all->patches; start += GROUP)
        slopes_of_group(all, start, in_group(all->patches - start));
}

/* --- patch_steps.py ------------------------------------------------------------------------------------------------------- */

enum step { EVIDENCE, MOVED, POSTERIOR };

/* The arrays of a step for n patches. Arrays that the step does not need are NULL. */
typedef struct {
    enum step step;
    const double *data, *error, *within, *pattern, *values, *jacobian, *state, *linear, *room, *spread;
    double *answer, *second, *third;  /* EVIDENCE: white, linear. MOVED: state. POSTERIOR: values before and after, covariance. */
    int64_t harmonics, patches;
} Steps;

INLINE void add_product(double *restrict to, const double *restrict a, const double *restrict b, int first) {
    if (first) EACH_PIXEL to[i] = a[i] * b[i];
    else EACH_PIXEL to[i] += a[i] * b[i];
}

INLINE void add_share(double *restrict to, double a, const double *restrict b, int first) {
    if (first) EACH_PIXEL to[i] = a * b[i];
    else EACH_PIXEL to[i] += a * b[i];
}

/* patch_steps.py: whitened. The covariances are in `left`, the right sides of k numbers in `white`. */
INLINE void whiten(PatchGroup *restrict g, int data, int k) {
    for (int from = 0; from < data; from++) {
        EACH_PIXEL g->scale[i] = 1.0 / sqrt(g->left[from][from][i]);
        for (int c = 0; c < k; c++) EACH_PIXEL g->white[from][c][i] *= g->scale[i];
        for (int j = from + 1; j < data; j++) EACH_PIXEL g->left[j][from][i] *= g->scale[i];
        for (int j = from + 1; j < data; j++) {
            const double *restrict share = g->left[j][from];
            for (int c = 0; c < k; c++) EACH_PIXEL g->white[j][c][i] -= share[i] * g->white[from][c][i];
            for (int c = from + 1; c <= j; c++) EACH_PIXEL g->left[j][c][i] -= share[i] * g->left[c][from][i];
        }
    }
}

/* Replace predicted data by observed minus predicted data. */
INLINE void differ(Row *restrict to, const double *restrict observed, int64_t n, int data, int m) {
    Row seen;
    for (int a = 0; a < data; a++) {
        take(&seen, observed + a * n, 1, n, m);
        EACH_PIXEL to[a][i] = seen[i] - to[a][i];
    }
}

/* The first rows and columns of the covariance of values, from the Jacobian and its product with that of the states. */
INLINE void scatter_pushed(PatchGroup *restrict g, int rows, int columns) {
    for (int a = 0; a < rows; a++)
        for (int b = 0; b < columns; b++)
            for (int j = 0; j < STATES; j++) add_product(g->covariance[a][b], g->pushed[j][a], g->jacobian[j][b], j == 0);
}

/* The same from the Jacobian and the covariance `spread` of the states. */
INLINE void scatter(PatchGroup *restrict g, const double *restrict spread, int rows, int columns) {
    for (int k = 0; k < STATES; k++)
        for (int a = 0; a < rows; a++)
            for (int j = 0; j < STATES; j++) add_share(g->pushed[k][a], spread[j * STATES + k], g->jacobian[j][a], j == 0);
    scatter_pushed(g, rows, columns);
}

/* Add the errors to the covariances: those of the data with the data into `left`, right sides into `white`. */
INLINE void add_error(PatchGroup *restrict g, const Steps *restrict all, int64_t start, int m, int data, int columns) {
    const int64_t n = all->patches;
    Row error;
    for (int a = 0; a < data; a++)
        for (int b = 0; b < columns; b++) {
            take(&error, all->error + (a * (data + 2) + b) * n + start, 1, n, m);
            double *restrict to = b < data ? g->left[a][b] : g->white[a][b];
            EACH_PIXEL to[i] = g->covariance[a][b][i] + error[i];
            if (columns > data && b < data) EACH_PIXEL g->white[a][b][i] = to[i];
        }
}

INLINE void evidence(PatchGroup *restrict g, const Steps *restrict all, int64_t start, int m, int data) {
    const int64_t n = all->patches;
    take(g->missed, all->values + start, data, n, m);
    differ(g->missed, all->data + start, n, data, m);
    for (int a = 0; a < data; a++) {
        if (a >= data / 2) EACH_PIXEL g->missed[a][i] = wrapped_d(g->missed[a][i]);
        for (int j = 0; j < STATES; j++) {
            EACH_PIXEL g->scale[i] = g->state[j][i] - g->pattern[j][i];
            add_product(g->pull[0], g->scale, g->jacobian[j][a], j == 0);
            memcpy(g->white[a][j], g->jacobian[j][a], sizeof(Row));
        }
        EACH_PIXEL g->white[a][STATES][i] = g->missed[a][i] + g->pull[0][i];
        give(all->second + a * n + start, g->white[a][STATES], m);
    }
    for (int j = 0; j < STATES; j++)
        for (int a = 0; a < data; a++) EACH_PIXEL g->pushed[j][a][i] = all->within[j] * g->jacobian[j][a][i];
    scatter_pushed(g, data, data);
    add_error(g, all, start, m, data, data);
    whiten(g, data, STATES + 1);
    for (int a = 0; a < data; a++)
        for (int k = 0; k <= STATES; k++) give(all->answer + (a * (STATES + 1) + k) * n + start, g->white[a][k], m);
}

INLINE void moved(PatchGroup *restrict g, const Steps *restrict all, int64_t start, int m, int data) {
    const int64_t n = all->patches;
    for (int a = 0; a < data; a++)
        for (int j = 0; j < STATES; j++) add_share(g->missed[a], all->room[j], g->jacobian[j][a], j == 0);
    differ(g->missed, all->linear + start, n, data, m);
    scatter(g, all->spread, data, data);
    add_error(g, all, start, m, data, data);
    for (int a = 0; a < data; a++) {
        for (int j = 0; j < STATES; j++) memcpy(g->white[a][j], g->jacobian[j][a], sizeof(Row));
        memcpy(g->white[a][STATES], g->missed[a], sizeof(Row));
    }
    whiten(g, data, STATES + 1);
    for (int k = 0; k < STATES; k++)
        for (int a = 0; a < data; a++) add_product(g->pull[k], g->white[a][k], g->white[a][STATES], a == 0);
    for (int k = 0; k < STATES; k++) {
        for (int j = 0; j < STATES; j++) add_share(g->scale, all->spread[j * STATES + k], g->pull[j], j == 0);
        EACH_PIXEL {
            const double change = all->room[k] + g->pattern[k][i] - g->state[k][i] + g->scale[i];
            g->state[k][i] += at_least(at_most(change, LARGEST_STEP), -LARGEST_STEP);
        }
        give(all->answer + k * n + start, g->state[k], m);
    }
}

INLINE void posterior(PatchGroup *restrict g, const Steps *restrict all, int64_t start, int m, int data) {
    const int64_t n = all->patches;
    const int values = data + 2;
    Row expected[MOST_VALUES];
    take(expected, all->values + start, values, n, m);
    memcpy(g->missed, expected, data * sizeof(Row));
    differ(g->missed, all->data + start, n, data, m);
    for (int j = 0; j < STATES; j++) EACH_PIXEL g->state[j][i] = all->room[j] + g->pattern[j][i] - g->state[j][i];
    for (int a = 0; a < values; a++) {
        for (int j = 0; j < STATES; j++) add_product(g->scale, g->state[j], g->jacobian[j][a], j == 0);
        EACH_PIXEL expected[a][i] += g->scale[i];
        if (a >= data / 2 && a < data) EACH_PIXEL expected[a][i] += FULL_TURN * rint(g->missed[a][i] / FULL_TURN);
        give(all->answer + a * n + start, expected[a], m);
    }
    scatter(g, all->spread, values, values);
    for (int a = 0; a < values; a++)
        for (int b = 0; b < values; b++) give(all->third + (a * values + b) * n + start, g->covariance[a][b], m);
    add_error(g, all, start, m, data, values);
    memcpy(g->missed, expected, data * sizeof(Row));
    differ(g->missed, all->data + start, n, data, m);
    for (int a = 0; a < data; a++) memcpy(g->white[a][values], g->missed[a], sizeof(Row));
    whiten(g, data, values + 1);
    for (int k = 0; k < values; k++) {
        for (int a = 0; a < data; a++) add_product(g->scale, g->white[a][k], g->white[a][values], a == 0);
        EACH_PIXEL g->scale[i] = expected[k][i] + g->scale[i];
        give(all->second + k * n + start, g->scale, m);
    }
}

INLINE void step_with(const Steps *restrict all, int data) {
    PatchGroup group, *g = &group;
    for (int64_t start = 0; start < all->patches; start += GROUP) {
        const int m = in_group(all->patches - start);
        take(g->state, all->state + start, STATES, all->patches, m);
        take(g->pattern, all->pattern + start, STATES, all->patches, m);
        for (int j = 0; j < STATES; j++)
            take(g->jacobian[j], all->jacobian + j * (data + 2) * all->patches + start, data + 2, all->patches, m);
        if (all->step == EVIDENCE) evidence(g, all, start, m, data);
        else if (all->step == MOVED) moved(g, all, start, m, data);
        else posterior(g, all, start, m, data);
    }
}

INLINE void step_of_patches(const Steps *restrict all) {
    /* the same call twice: if the number of harmonics is a constant, compilers unroll the loops */
    if (all->harmonics == 2) step_with(all, 2);
    else step_with(all, data_of((int)all->harmonics));
}
