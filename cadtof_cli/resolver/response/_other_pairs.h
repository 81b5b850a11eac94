/* Other pairs of paths that explain the phasors nearly as well: the operations of other_pairs.py, in their order. Groups of
 * pixels are moved together; a group goes on as long as one of its pixels does. */
#include "_newton.h"

#define MOVES 16
#define SURE_MOVES 3

/* Constants that all pixels share: those of the search up to PER_STEP, then the ratio of harmonic 2, MOVE, and the rule of
 * the direct path. */
enum { RATIO = PER_STEP + 1, MOVE, LEAST_RATIO, SIGN, FOLLOW_CONSTANTS };

typedef struct {
    const float *constants;
    const float *table[2];     /* for each harmonic: ENTRIES times re, im and their slopes */
    const float *phase_rad;    /* own phases of the pixels, 2 x pixels; NULL: none */
    const float *phasor;       /* 4 x pixels: re, im of harmonic 1, then of 2 */
    const float *per_variance; /* pixels */
    const float *found;        /* 2 x pixels: phases of both paths */
    const float *sigma;        /* 2 x pixels: their standard deviations */
    float *farthest;           /* 2 x pixels */
    int64_t pixels;
} Follow;

/* The answers of both harmonics to two paths, path 0 the one that is moved, and what is known of the pixels. */
typedef struct {
    Side side[2];
    FloatRow phasor[4], phase_rad[2], per_variance, found[2], sigma[2], farthest[2], at, misfit, amplitude[2], step, usual, going;
} FollowGroup;

/* newton.py: ResponseBlock.at, at both harmonics; Recorded.answers */
INLINE void answers(FollowGroup *restrict g, const Follow *restrict follow, int path, const float *restrict phase) {
    for (int row = 0; row < 2; row++) {
        const float number = follow->constants[NUMBER_1 + row];
        FloatRow theta;
        if (follow->phase_rad) EACH_PIXEL theta[i] = phase[i] * number + g->phase_rad[row][i];
        else EACH_PIXEL theta[i] = phase[i] * number;
        look_up(&g->side[row], path, theta, follow->table[row], follow->constants[PER_STEP], follow->constants[BACK_1 + row]);
    }
    const float ratio = follow->constants[RATIO];
    Side *restrict second = &g->side[1];
    EACH_PIXEL {
        second->re[path][i] *= ratio;
        second->im[path][i] *= ratio;
        second->slope_re[path][i] *= ratio;
        second->slope_im[path][i] *= ratio;
    }
}

/* other_pairs.py: Vector, _dot, _less */
typedef struct {
    float re, im, re2, im2;
} Four;

INLINE float dot(Four u, Four v) { return u.re * v.re + u.im * v.im + u.re2 * v.re2 + u.im2 * v.im2; }

INLINE Four less(Four u, float share, Four v) {
    const Four left = {u.re - share * v.re, u.im - share * v.im, u.re2 - share * v.re2, u.im2 - share * v.im2};
    return left;
}

/* other_pairs.py: fit_beside */
INLINE void fit_beside(FollowGroup *restrict g) {
    const Side *restrict s = &g->side[0], *restrict t = &g->side[1];
    EACH_PIXEL {
        const Four moved = {s->re[0][i], s->im[0][i], t->re[0][i], t->im[0][i]};
        Four other = {s->re[1][i], s->im[1][i], t->re[1][i], t->im[1][i]};
        Four slope = {s->slope_re[1][i], s->slope_im[1][i], t->slope_re[1][i], t->slope_im[1][i]};
        Four seen = {g->phasor[0][i], g->phasor[1][i], g->phasor[2][i], g->phasor[3][i]};
        const float per_moved = 1.0f / dot(moved, moved);
        const float other_along = dot(other, moved) * per_moved, slope_along = dot(slope, moved) * per_moved;
        const float seen_along = dot(seen, moved) * per_moved;
        other = less(other, other_along, moved);
        slope = less(slope, slope_along, moved);
        seen = less(seen, seen_along, moved);
        const float per_other = 1.0f / dot(other, other);
        const float slope_across = dot(slope, other) * per_other, seen_across = dot(seen, other) * per_other;
        slope = less(slope, slope_across, other);
        seen = less(seen, seen_across, other);
        const float turned = dot(seen, slope) / dot(slope, slope);
        seen = less(seen, turned, slope);
        const float amplitude = seen_across - turned * slope_across;
        const float beside = seen_along - amplitude * other_along - turned * slope_along;
        float step = turned / amplitude;
        step = step < -0.4f ? -0.4f : step;
        step = step > 0.4f ? 0.4f : step;
        g->misfit[i] = dot(seen, seen) * g->per_variance[i];
        g->amplitude[0][i] = beside;
        g->amplitude[1][i] = amplitude;
        g->step[i] = step;
    }
}

/* other_pairs.py: the loop over MOVES in `reach`. A pixel that does not go on stays as it is. */
INLINE void follow_to_side(FollowGroup *restrict g, const Follow *restrict follow, int moved, float side) {
    const int other = 1 - moved;
    const float length = follow->constants[MOVE], least = follow->constants[LEAST_RATIO], sign = follow->constants[SIGN];
    EACH_PIXEL {
        const float per_sigma = length / g->sigma[moved][i];
        g->usual[i] = per_sigma * per_sigma * 0.5f;
        g->at[i] = g->found[other][i];
    }
    for (int number = 1; number <= MOVES; number++) {
        const float turn = (float)number * (side * length), square = (float)(number * number);
        FloatRow phase;
        EACH_PIXEL phase[i] = g->found[moved][i] + turn;
        answers(g, follow, 0, phase);
        answers(g, follow, 1, g->at);
        fit_beside(g);
        const float *restrict direct = g->amplitude[moved], *restrict mpi = g->amplitude[other];
        int32_t going = 0;
        EACH_PIXEL {
            g->at[i] = g->at[i] + g->step[i];
            const int alike = (direct[i] > 0.0f) & (mpi[i] > 0.0f) & (g->misfit[i] < 9.0f) & (fabsf(g->step[i]) < 0.15f);
            const int counts = alike & (g->going[i] > 0.0f);
            /* Rule.errors */
            const float other_by = g->at[i] - g->found[other][i], gap = g->found[1][i] - g->found[0][i];
            const float direct_by = moved ? other_by : turn, mpi_by = moved ? turn : other_by;
            const float order = (gap + mpi_by - direct_by) * sign;
            const int swapped = (direct[i] < least * mpi[i]) | ((mpi[i] >= least * direct[i]) & (order < 0.0f));
            const float root = sqrtf(larger(g->misfit[i], 3.0f));
            const float error = fabsf(swapped ? gap + mpi_by : direct_by) / root;
            const float error_of_mpi = fabsf(swapped ? direct_by - gap : mpi_by) / root;
            g->farthest[0][i] = counts & (error > g->farthest[0][i]) ? error : g->farthest[0][i];
            g->farthest[1][i] = counts & (error_of_mpi > g->farthest[1][i]) ? error_of_mpi : g->farthest[1][i];
            const int goes_on = (number < SURE_MOVES) | alike | (g->misfit[i] < square * g->usual[i]);
            g->going[i] = goes_on ? g->going[i] : 0.0f;
            going |= g->going[i] > 0.0f;
        }
        if (!going) return;
    }
}

INLINE void follow_pairs(const Follow *restrict follow) {
    FollowGroup group, *g = &group;
    const int64_t n = follow->pixels;
    memset(g, 0, sizeof group);
    for (int64_t start = 0; start < n; start += GROUP) {
        const int m = in_group(n - start);
        for (int i = 0; i < m; i++) {
            const int64_t pixel = start + i;
            for (int v = 0; v < 4; v++) g->phasor[v][i] = follow->phasor[v * n + pixel];
            for (int path = 0; path < 2; path++) {
                g->found[path][i] = follow->found[path * n + pixel];
                g->sigma[path][i] = follow->sigma[path * n + pixel];
            }
            if (follow->phase_rad)
                for (int row = 0; row < 2; row++) g->phase_rad[row][i] = follow->phase_rad[row * n + pixel];
            g->per_variance[i] = follow->per_variance[pixel];
        }
        EACH_PIXEL g->farthest[0][i] = g->farthest[1][i] = 0.0f;
        for (int moved = 0; moved < 2; moved++)
            for (int side = -1; side <= 1; side += 2) {
                EACH_PIXEL g->going[i] = i < m ? 1.0f : 0.0f;
                follow_to_side(g, follow, moved, (float)side);
            }
        for (int path = 0; path < 2; path++)
            for (int i = 0; i < m; i++) follow->farthest[path * n + start + i] = g->farthest[path][i];
    }
}
