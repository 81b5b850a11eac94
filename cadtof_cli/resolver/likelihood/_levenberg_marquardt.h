/* Levenberg–Marquardt for many small least-squares problems, LANES problems at a time: the same operations in the same
 * order as levenberg_marquardt.py, mixture.py and normal_equations.py, so that all bits are the same.
 *
 * A lane holds one problem. When the problem stops, its answer is written and the next problem takes the lane. The
 * start of the new problem is linearised together with the next points of the other lanes. No operation mixes values of
 * different lanes.
 */
#include <math.h>
#include <stdint.h>
#include <string.h>

#if defined(__GNUC__) || defined(__clang__)
#ifndef LANES
#define LANES 8
#endif
typedef double Row __attribute__((vector_size(8 * LANES)));
typedef int64_t Mask __attribute__((vector_size(8 * LANES)));
#define BELOW(a, b) ((Mask)((a) < (b)))
#define UP_TO(a, b) ((Mask)((a) <= (b)))
#define SAME(a, b) ((Mask)((a) == (b)))
#define SELECT(mask, a, b) ((Row)(((mask) & (Mask)(a)) | (~(mask) & (Mask)(b))))
#define ALL(number) ((Row){0} + (number))
#else
#define LANES 1
typedef double Row;
typedef int64_t Mask;
#define BELOW(a, b) (-(Mask)((a) < (b)))
#define UP_TO(a, b) (-(Mask)((a) <= (b)))
#define SAME(a, b) (-(Mask)((a) == (b)))
#define SELECT(mask, a, b) ((mask) ? (a) : (b))
#define ALL(number) ((Row)(number))
#endif
#ifndef GROUPS
#define GROUPS 2
#endif
#define LANE(values, lane) (((double *)&(values))[lane])
#define FLAG(values, lane) (((int64_t *)&(values))[lane])

enum kind { WHITE, WEIGHTED, RESPONSE };
enum {
    MOST_PATHS = 4,
    MOST_ROWS = 8,
    MOST_HARMONIC = 16,
    MOST_POINTS = 3 * MOST_PATHS,
    MOST_STEPS = 2 * MOST_PATHS,
    MOST_ENTRIES = MOST_STEPS * (MOST_STEPS + 1) / 2
};

#define LEAST_PIVOT 1e-14
#define TINY 2.2250738585072014e-308
#define MOST_DAMPING 1e12

/* The problems, and the arrays for the answers. Arrays consist of planes of `count` numbers. */
typedef struct {
    int kind, paths, rows, most_steps; /* kind: of enum kind; rows: number of harmonics */
    int64_t count;
    const int64_t *harmonics;
    double relative, first_damping;
    const double *re, *im;             /* parts of the measured phasors */
    const double *weights;             /* WHITE: one per row; otherwise re_re, re_im, im_im, a plane per row each */
    const double *starts, *worth;
    double *points, *cost, *matrix;
    uint8_t *converged;
    const float *tables;               /* RESPONSE: the table of each row */
    const float *own_rad;              /* RESPONSE: own phases of the pixels, a plane per row; NULL: none */
    const double *own_rotors;          /* RESPONSE: their cosines and sines, side by side; NULL: none */
} Search;

typedef struct {
    Row matrix[MOST_ENTRIES], gradient[MOST_STEPS], cost;
} Linear;

typedef struct {
    Row re[MOST_ROWS], im[MOST_ROWS], weights[3][MOST_ROWS];
    Row own[3][MOST_ROWS]; /* RESPONSE: own phase, its cosine and sine */
    Row point[MOST_POINTS], trial[MOST_POINTS];
    Linear now, there;
    Row damping, growth, worth, promised, steps;
    Mask done, fresh, busy;
    int64_t problem[LANES]; /* index of the problem that a lane holds */
} Lanes;

#define ENTRY(i, j) ((i) * ((i) + 1) / 2 + (j))

static KERNEL_INLINE inline int any(const Mask *flags) {
    int64_t found = 0;
    for (int lane = 0; lane < LANES; lane++) found |= FLAG(*flags, lane);
    return found != 0;
}

static KERNEL_INLINE inline void roots(Row *values) {
    for (int lane = 0; lane < LANES; lane++) LANE(*values, lane) = sqrt(LANE(*values, lane));
}

/* rotors.py: unit_rotor. The rotor of 0 is 1. */
static KERNEL_INLINE inline void unit_rotor(const Row *re, const Row *im, Row *modulus, Row *cos, Row *sin) {
    Row length = *re * *re + *im * *im;
    roots(&length);
    const Row zero = SELECT(SAME(length, ALL(0.0)), ALL(1.0), ALL(0.0));
    const Row scale = 1.0 / (length + zero);
    *modulus = length;
    *cos = *re * scale + zero;
    *sin = *im * scale;
}

/* rotors.py: product. */
static KERNEL_INLINE inline void multiply(const Row *a, const Row *b, Row *to) {
    const Row re = a[0] * b[0] - a[1] * b[1], im = a[0] * b[1] + a[1] * b[0];
    to[0] = re;
    to[1] = im;
}

/* The largest number of the harmonics. */
static inline int64_t largest(const int64_t *harmonics, int rows) {
    int64_t most = 1;
    for (int row = 0; row < rows; row++) most = harmonics[row] > most ? harmonics[row] : most;
    return most;
}

/* The powers of a rotor that are wanted, by their exponents. */
typedef Row Powers[2 * MOST_HARMONIC + 1][2];

/* rotors.py: powers, up to `most`. */
static KERNEL_INLINE inline void powers(const Row *cos, const Row *sin, int64_t most, Row (*power)[2]) {
    power[1][0] = *cos;
    power[1][1] = *sin;
    for (int64_t h = 2; h <= most; h++) multiply(power[h / 2], power[h - h / 2], power[h]);
}

/* mixture.py: Mixture.phasors, for one harmonic. */
static KERNEL_INLINE inline void light_of(const Row *amplitude, Powers *rotor, int paths, int64_t h, Row *re, Row *im) {
    *re = amplitude[0] * rotor[0][h][0];
    *im = amplitude[0] * rotor[0][h][1];
    for (int k = 1; k < paths; k++) {
        *re += amplitude[k] * rotor[k][h][0];
        *im += amplitude[k] * rotor[k][h][1];
    }
}

/* mixture.py: Measured.rest. */
static KERNEL_INLINE inline void rest_of(const Lanes *lanes, const Row *amplitude, Powers *rotor, int paths, int row, int64_t h,
                                         Row *re, Row *im) {
    light_of(amplitude, rotor, paths, h, re, im);
    *re = lanes->re[row] - *re;
    *im = lanes->im[row] - *im;
}

/* mixture.py: WhiteFit.linearised. */
static KERNEL_INLINE inline void linearise_white(const Search *search, const Lanes *lanes, const Row *point, Linear *at, int k) {
    Powers rotor[MOST_PATHS];
    const int64_t most = largest(search->harmonics, search->rows);
    for (int i = 0; i < k; i++) powers(&point[k + i], &point[2 * k + i], most, rotor[i]);
    for (int row = 0; row < search->rows; row++) {
        const int64_t number = search->harmonics[row];
        const double h = (double)number, weight = search->weights[row];
        Row re, im;
        rest_of(lanes, point, rotor, k, row, number, &re, &im);
        at->cost += weight * (re * re + im * im);
        for (int i = 0; i < k; i++) {
            const Row cos = rotor[i][number][0], sin = rotor[i][number][1];
            at->gradient[i] += weight * (cos * re + sin * im);
            at->gradient[k + i] += (weight * h) * (cos * im - sin * re);
            at->matrix[ENTRY(i, i)] += ALL(weight);
            at->matrix[ENTRY(k + i, k + i)] += ALL(weight * h * h);
            for (int j = 0; j < i; j++) {
                const Row cos_j = rotor[j][number][0], sin_j = rotor[j][number][1];
                const Row in_phase = weight * (cos * cos_j + sin * sin_j);
                const Row quadrature = (weight * h) * (sin * cos_j - cos * sin_j);
                at->matrix[ENTRY(i, j)] += in_phase;
                at->matrix[ENTRY(k + i, k + j)] += (h * h) * in_phase;
                at->matrix[ENTRY(k + j, i)] += quadrature;
                at->matrix[ENTRY(k + i, j)] -= quadrature;
            }
        }
    }
}

/* mixture.py: equations_of, for one harmonic. `re` and `im` are what the paths leave of its phasor. */
static KERNEL_INLINE inline void add_row(const Lanes *lanes, int row, const Row *re, const Row *im, const Row *slope_re,
                                         const Row *slope_im, Linear *at, int k) {
    const Row a = lanes->weights[0][row], b = lanes->weights[1][row], d = lanes->weights[2][row];
    at->cost += (a * *re + 2.0 * b * *im) * *re + d * *im * *im;
    for (int i = 0; i < 2 * k; i++) {
        const Row weighted_re = a * slope_re[i] + b * slope_im[i], weighted_im = b * slope_re[i] + d * slope_im[i];
        at->gradient[i] += weighted_re * *re + weighted_im * *im;
        for (int j = 0; j <= i; j++) at->matrix[ENTRY(i, j)] += weighted_re * slope_re[j] + weighted_im * slope_im[j];
    }
}

/* mixture.py: WeightedFit.linearised. */
static KERNEL_INLINE inline void linearise_weighted(const Search *search, const Lanes *lanes, const Row *point, Linear *at, int k) {
    Powers rotor[MOST_PATHS];
    const int64_t most = largest(search->harmonics, search->rows);
    for (int i = 0; i < k; i++) powers(&point[k + i], &point[2 * k + i], most, rotor[i]);
    for (int row = 0; row < search->rows; row++) {
        const int64_t number = search->harmonics[row];
        const double h = (double)number;
        Row re, im, slope_re[MOST_STEPS], slope_im[MOST_STEPS];
        rest_of(lanes, point, rotor, k, row, number, &re, &im);
        for (int i = 0; i < k; i++) {
            slope_re[i] = rotor[i][number][0];
            slope_im[i] = rotor[i][number][1];
            slope_re[k + i] = -h * rotor[i][number][1];
            slope_im[k + i] = h * rotor[i][number][0];
        }
        add_row(lanes, row, &re, &im, slope_re, slope_im, at, k);
    }
}

#include "../response/_more_harmonics.h"

/* normal_equations.py: cholesky and solve; the diagonal of `lower` holds 1/L_ii. */
static KERNEL_INLINE inline void solve(const Linear *at, const Row *damping, int size, Row *x) {
    Row lower[MOST_ENTRIES];
    const Row raised = 1.0 + *damping;
    for (int j = 0; j < size; j++) {
        const Row diagonal = at->matrix[ENTRY(j, j)] * raised;
        Row pivot = diagonal;
        for (int k = 0; k < j; k++) pivot -= lower[ENTRY(j, k)] * lower[ENTRY(j, k)];
        const Row least = LEAST_PIVOT * diagonal + TINY;
        pivot = SELECT(BELOW(pivot, least), least, pivot); /* NaN stays NaN, as in numpy.maximum */
        roots(&pivot);
        lower[ENTRY(j, j)] = 1.0 / pivot;
        for (int i = j + 1; i < size; i++) {
            Row rest = at->matrix[ENTRY(i, j)];
            for (int k = 0; k < j; k++) rest -= lower[ENTRY(i, k)] * lower[ENTRY(j, k)];
            lower[ENTRY(i, j)] = rest * lower[ENTRY(j, j)];
        }
    }
    for (int i = 0; i < size; i++) {
        x[i] = at->gradient[i];
        for (int k = 0; k < i; k++) x[i] -= lower[ENTRY(i, k)] * x[k];
        x[i] *= lower[ENTRY(i, i)];
    }
    for (int i = size - 1; i >= 0; i--) {
        for (int k = i + 1; k < size; k++) x[i] -= lower[ENTRY(k, i)] * x[k];
        x[i] *= lower[ENTRY(i, i)];
    }
}

/* Compute the next points of all lanes, except fresh ones, and the decrease of the cost that the steps promise. */
static KERNEL_INLINE inline void step(Lanes *lanes, double relative, int k) {
    const int size = 2 * k;
    Row x[MOST_STEPS], trial[MOST_POINTS];
    solve(&lanes->now, &lanes->damping, size, x);
    lanes->promised = ALL(0.0);
    for (int i = 0; i < size; i++)
        lanes->promised += x[i] * (lanes->now.gradient[i] + lanes->damping * lanes->now.matrix[ENTRY(i, i)] * x[i]);
    lanes->done = UP_TO(lanes->promised, relative * lanes->now.cost + lanes->worth);
    for (int i = 0; i < k; i++) { /* mixture.py: moved_paths */
        const Row along = lanes->point[i] + x[i], *cos = &lanes->point[k + i], *sin = &lanes->point[2 * k + i];
        Row turn_cos, turn_sin;
        unit_rotor(&along, &x[k + i], &trial[i], &turn_cos, &turn_sin);
        trial[k + i] = *cos * turn_cos - *sin * turn_sin;
        trial[2 * k + i] = *cos * turn_sin + *sin * turn_cos;
    }
    for (int i = 0; i < 3 * k; i++) lanes->trial[i] = SELECT(lanes->fresh, lanes->trial[i], trial[i]);
}

/* levenberg_marquardt.py: the second part of _stepped. Sets which lanes have stopped. */
static KERNEL_INLINE inline void judge(Lanes *lanes, double first_damping, int entries, int size, int points, Mask *stopped) {
    const Linear *now = &lanes->now, *there = &lanes->there;
    const Row gain = (now->cost - there->cost) / lanes->promised;
    const Mask down = BELOW(there->cost, now->cost), moves = down | lanes->fresh;
    const Row twice = 2.0 * gain - 1.0, cube = twice * twice * twice;
    Row eased = 1.0 - cube;
    eased = SELECT(BELOW(eased, ALL(0.1)), ALL(0.1), eased);
    const Row damping = SELECT(down, lanes->damping * eased, lanes->damping * lanes->growth);
    const Row growth = SELECT(down, ALL(2.0), 2.0 * lanes->growth);
    const Mask finite = SAME(lanes->promised - lanes->promised, ALL(0.0));
    *stopped = (lanes->done | ~BELOW(damping, ALL(MOST_DAMPING)) | ~finite) & ~lanes->fresh;
    lanes->damping = SELECT(lanes->fresh, ALL(first_damping), damping);
    lanes->growth = SELECT(lanes->fresh, ALL(2.0), growth);
    for (int i = 0; i < points; i++) lanes->point[i] = SELECT(moves, lanes->trial[i], lanes->point[i]);
    for (int i = 0; i < entries; i++) lanes->now.matrix[i] = SELECT(moves, there->matrix[i], now->matrix[i]);
    for (int i = 0; i < size; i++) lanes->now.gradient[i] = SELECT(moves, there->gradient[i], now->gradient[i]);
    lanes->now.cost = SELECT(moves, there->cost, now->cost);
}

static inline void load(const Search *search, Lanes *lanes, int lane, int64_t problem, int points) {
    const int64_t n = search->count;
    lanes->problem[lane] = problem;
    FLAG(lanes->fresh, lane) = FLAG(lanes->busy, lane) = -1;
    LANE(lanes->steps, lane) = 0.0;
    LANE(lanes->worth, lane) = search->worth[problem];
    for (int i = 0; i < points; i++) LANE(lanes->trial[i], lane) = search->starts[i * n + problem];
    for (int row = 0; row < search->rows; row++) {
        LANE(lanes->re[row], lane) = search->re[row * n + problem];
        LANE(lanes->im[row], lane) = search->im[row * n + problem];
        if (search->kind == WHITE) continue;
        for (int part = 0; part < 3; part++)
            LANE(lanes->weights[part][row], lane) = search->weights[(part * search->rows + row) * n + problem];
        if (!search->own_rad) continue;
        LANE(lanes->own[0][row], lane) = search->own_rad[row * n + problem];
        for (int part = 0; part < 2; part++)
            LANE(lanes->own[1 + part][row], lane) = search->own_rotors[2 * (row * n + problem) + part];
    }
}

static inline void store(const Search *search, Lanes *lanes, int lane, int stopped, int entries, int points) {
    const int64_t n = search->count, problem = lanes->problem[lane];
    for (int i = 0; i < points; i++) search->points[i * n + problem] = LANE(lanes->point[i], lane);
    for (int i = 0; i < entries; i++) search->matrix[i * n + problem] = LANE(lanes->now.matrix[i], lane);
    search->cost[problem] = LANE(lanes->now.cost, lane);
    search->converged[problem] = stopped && FLAG(lanes->done, lane);
}

/* Write the answers of lanes whose problem has ended, and load the next problems into these lanes. Return the number of
 * lanes that are left without a problem. */
static inline int64_t exchange(const Search *search, Lanes *lanes, const Mask *ends, const Mask *stopped, int64_t *next, int entries,
                               int points) {
    int64_t idle = 0;
    for (int lane = 0; lane < LANES; lane++) {
        if (!FLAG(*ends, lane)) continue;
        store(search, lanes, lane, FLAG(*stopped, lane) != 0, entries, points);
        FLAG(lanes->busy, lane) = 0;
        if (*next < search->count) load(search, lanes, lane, (*next)++, points);
        else idle++;
    }
    return idle;
}

/* Solve the problems of one kind with k paths. There are two groups of lanes: while one waits for a root or a quotient,
 * the processor works on the other. */
static KERNEL_INLINE inline void search_kind(const Search *search, enum kind kind, int k) {
    const int size = 2 * k, entries = ENTRY(size, 0), points = 3 * k;
    const Row most_steps = ALL((double)search->most_steps);
    Lanes groups[GROUPS];
    int64_t next = 0, held = 0;
    memset(groups, 0, sizeof groups);
    for (int group = 0; group < GROUPS; group++)
        for (int lane = 0; lane < LANES && next < search->count; lane++, held++)
            load(search, &groups[group], lane, next++, points);
    while (held) {
        for (int group = 0; group < GROUPS; group++) step(&groups[group], search->relative, k);
        for (int group = 0; group < GROUPS; group++) {
            Lanes *lanes = &groups[group];
            lanes->there.cost = ALL(0.0);
            for (int i = 0; i < entries; i++) lanes->there.matrix[i] = ALL(0.0);
            for (int i = 0; i < size; i++) lanes->there.gradient[i] = ALL(0.0);
            if (kind == WHITE) linearise_white(search, lanes, lanes->trial, &lanes->there, k);
            if (kind == WEIGHTED) linearise_weighted(search, lanes, lanes->trial, &lanes->there, k);
            if (kind == RESPONSE) linearise_response(search, lanes, lanes->trial, &lanes->there, k);
        }
        for (int group = 0; group < GROUPS; group++) {
            Lanes *lanes = &groups[group];
            Mask stopped;
            judge(lanes, search->first_damping, entries, size, points, &stopped);
            lanes->steps += SELECT(lanes->fresh, ALL(0.0), ALL(1.0));
            lanes->fresh = lanes->fresh & ~lanes->fresh;
            const Mask ends = (stopped | UP_TO(most_steps, lanes->steps)) & lanes->busy;
            if (any(&ends)) held -= exchange(search, lanes, &ends, &stopped, &next, entries, points);
        }
    }
}

/* The weights that follow from the noise of the light of given paths. Arrays consist of planes of `count` numbers. */
typedef struct {
    int paths, rows;
    int64_t count;
    const int64_t *harmonics;
    const double *noise; /* level, double and averaging of HarmonicNoise.covariance, for each row */
    const double *points;
    double *weights; /* re_re, re_im, im_im, a plane per row each */
} Weigh;

/* mixture.py: WeightedFit.around, with HarmonicNoise.covariance. */
static KERNEL_INLINE inline void weigh_lanes(const Weigh *weigh, int64_t start, int held) {
    Row amplitude[MOST_PATHS], cos = ALL(0.0), sin = ALL(0.0), total = ALL(0.0);
    Powers rotor[MOST_PATHS];
    const int k = weigh->paths;
    const int64_t most = 2 * largest(weigh->harmonics, weigh->rows);
    for (int i = 0; i < k; i++) {
        for (int lane = 0; lane < LANES; lane++) {
            const double *point = weigh->points + start + (lane < held ? lane : 0);
            LANE(amplitude[i], lane) = point[i * weigh->count];
            LANE(cos, lane) = point[(k + i) * weigh->count];
            LANE(sin, lane) = point[(2 * k + i) * weigh->count];
        }
        total = i ? total + amplitude[i] : amplitude[i];
        powers(&cos, &sin, most, rotor[i]);
    }
    total = SELECT(BELOW(total, ALL(1.0)), ALL(1.0), total);
    for (int i = 0; i < k; i++) amplitude[i] /= total;
    for (int row = 0; row < weigh->rows; row++) {
        const int64_t h = weigh->harmonics[row];
        const double level = weigh->noise[3 * row], twice = weigh->noise[3 * row + 1], averaging = weigh->noise[3 * row + 2];
        Row re, im, re2, im2;
        light_of(amplitude, rotor, k, h, &re, &im);
        light_of(amplitude, rotor, k, 2 * h, &re2, &im2);
        const Row re_re = level + twice * re2 - averaging * re * re, im_im = level - twice * re2 - averaging * im * im;
        const Row re_im = twice * im2 - averaging * re * im, scale = 1.0 / (re_re * im_im - re_im * re_im);
        const Row entry[3] = {im_im * scale, -re_im * scale, re_re * scale};
        for (int part = 0; part < 3; part++)
            for (int lane = 0; lane < held; lane++)
                weigh->weights[(part * weigh->rows + row) * weigh->count + start + lane] = ((const double *)&entry[part])[lane];
    }
}

static KERNEL_INLINE inline void weigh_all(const Weigh *weigh) {
    for (int64_t start = 0; start < weigh->count; start += LANES)
        weigh_lanes(weigh, start, weigh->count - start < LANES ? (int)(weigh->count - start) : LANES);
}

#define SEARCH(kind) \
    switch (search->paths) { \
    case 1: search_kind(search, kind, 1); break; \
    case 2: search_kind(search, kind, 2); break; \
    default: search_kind(search, kind, search->paths); \
    }

static KERNEL_INLINE inline void search_all(const Search *search) {
    if (search->kind == WHITE) SEARCH(WHITE)
    else if (search->kind == WEIGHTED) SEARCH(WEIGHTED)
    else SEARCH(RESPONSE)
}
