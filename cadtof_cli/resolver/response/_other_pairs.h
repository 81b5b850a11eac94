/* Other pairs of paths that explain the phasors nearly as well: the operations of other_pairs.py, in their order. Groups of
 * pixels are moved together; a group goes on as long as one of its pixels does. */
#include "_newton.h"

#define MOVES 16
#define SURE_MOVES 3
#define MOST_ROWS 8 /* kernels.py: MOST_HARMONICS */
#define MOST_PARTS (2 * MOST_ROWS)

/* Constants that all pixels share; after these come, for each harmonic, its number h, then 2 pi / ENTRIES / h of each, then
 * the ratio of each. */
enum { FOLLOW_PER_STEP, MOVE, LEAST_RATIO, SIGN, FOLLOW_CONSTANTS };

typedef struct {
    const float *constants;
    const float *tables;       /* rows x ENTRIES times re, im and their slopes */
    const float *phase_rad;    /* own phases of the pixels, rows x pixels; NULL: none */
    const float *phasor;       /* 2 rows x pixels: re, im of each harmonic */
    const float *per_variance; /* pixels */
    const float *found;        /* 2 x pixels: phases of both paths */
    const float *sigma;        /* 2 x pixels: their standard deviations */
    float *farthest;           /* 2 x pixels */
    int64_t pixels;
    int rows;                  /* number of harmonics */
} Follow;

/* The vectors of other_pairs.py have re and im of each harmonic. `moved` belongs to the path that is moved, `other` and `slope`
 * to the other one. */
typedef struct {
    FloatRow moved[MOST_PARTS], other[MOST_PARTS], slope[MOST_PARTS], phasor[MOST_PARTS], own[MOST_ROWS];
    FloatRow per_variance, found[2], sigma[2], farthest[2], least, misfit, amplitude[2], step, going;
} FollowGroup;

/* other_pairs.py: WeightedPhasors.answers. If `slope` is NULL, it is not wanted. */
INLINE void answers(const FollowGroup *restrict g, const Follow *restrict follow, const float *restrict phase, FloatRow *restrict to,
                    FloatRow *restrict slope) {
    const float *numbers = follow->constants + FOLLOW_CONSTANTS, *back = numbers + follow->rows, *ratios = back + follow->rows;
    for (int row = 0; row < follow->rows; row++) {
        const float number = numbers[row], ratio = ratios[row];
        FloatRow theta;
        if (follow->phase_rad) EACH_PIXEL theta[i] = phase[i] * number + g->own[row][i];
        else EACH_PIXEL theta[i] = phase[i] * number;
        Side side;
        look_up(&side, 0, theta, follow->tables + 4 * (int64_t)ENTRIES * row, follow->constants[FOLLOW_PER_STEP], back[row]);
        EACH_PIXEL to[2 * row][i] = side.re[0][i] * ratio;
        EACH_PIXEL to[2 * row + 1][i] = side.im[0][i] * ratio;
        if (slope) {
            EACH_PIXEL slope[2 * row][i] = side.slope_re[0][i] * ratio;
            EACH_PIXEL slope[2 * row + 1][i] = side.slope_im[0][i] * ratio;
        }
    }
}

/* other_pairs.py: _dot */
INLINE float dot(const float *u, const float *v, const int parts) {
    float product = u[0] * v[0];
    for (int part = 1; part < parts; part++) product = product + u[part] * v[part];
    return product;
}

/* other_pairs.py: _less, in the place of u */
INLINE void take_off(float *restrict u, float share, const float *restrict v, const int parts) {
    for (int part = 0; part < parts; part++) u[part] = u[part] - share * v[part];
}

/* other_pairs.py: fit_beside */
INLINE void fit_parts_beside(FollowGroup *restrict g, const int parts) {
    EACH_PIXEL {
        float moved[MOST_PARTS], other[MOST_PARTS], slope[MOST_PARTS], seen[MOST_PARTS];
        for (int part = 0; part < parts; part++) {
            moved[part] = g->moved[part][i];
            other[part] = g->other[part][i];
            slope[part] = g->slope[part][i];
            seen[part] = g->phasor[part][i];
        }
        const float per_moved = 1.0f / dot(moved, moved, parts);
        const float other_along = dot(other, moved, parts) * per_moved, slope_along = dot(slope, moved, parts) * per_moved;
        const float seen_along = dot(seen, moved, parts) * per_moved;
        take_off(other, other_along, moved, parts);
        take_off(slope, slope_along, moved, parts);
        take_off(seen, seen_along, moved, parts);
        const float per_other = 1.0f / dot(other, other, parts);
        const float slope_across = dot(slope, other, parts) * per_other, seen_across = dot(seen, other, parts) * per_other;
        take_off(slope, slope_across, other, parts);
        take_off(seen, seen_across, other, parts);
        const float turned = dot(seen, slope, parts) / dot(slope, slope, parts);
        take_off(seen, turned, slope, parts);
        const float amplitude = seen_across - turned * slope_across;
        const float step = turned / amplitude, low = step < -LARGEST_TURN ? -LARGEST_TURN : step;
        g->amplitude[0][i] = seen_along - amplitude * other_along - turned * slope_along;
        g->amplitude[1][i] = amplitude;
        g->step[i] = low > LARGEST_TURN ? LARGEST_TURN : low;
        g->misfit[i] = dot(seen, seen, parts) * g->per_variance[i];
    }
}

/* With a constant number of parts, the compiler keeps them in registers. */
INLINE void fit_beside(FollowGroup *restrict g, int rows) {
    if (rows == 2) fit_parts_beside(g, 4);
    else if (rows == 3) fit_parts_beside(g, 6);
    else if (rows == 4) fit_parts_beside(g, 8);
    else fit_parts_beside(g, 2 * rows);
}

INLINE int any_going(const float *restrict going) {
    int32_t found = 0;
    EACH_PIXEL found |= going[i] > 0.0f;
    return found != 0;
}

/* other_pairs.py: the loop over MOVES in `reach`. Rows whose place depends on `moved` are copied: otherwise the compiler has to
 * assume that they overlap others. */
INLINE void follow_to_side(FollowGroup *restrict g, const Follow *restrict follow, const int moved, float side) {
    const float length = follow->constants[MOVE], least = follow->constants[LEAST_RATIO], sign = follow->constants[SIGN];
    FloatRow from, from_other, usual, at, gap;
    EACH_PIXEL from[i] = g->found[moved][i];
    EACH_PIXEL at[i] = from_other[i] = g->found[1 - moved][i];
    EACH_PIXEL {
        const float per_sigma = length / g->sigma[moved][i];
        usual[i] = per_sigma * per_sigma * 0.5f;
        gap[i] = g->found[1][i] - g->found[0][i];
    }
    for (int number = 1; number <= MOVES; number++) {
        const float turn = (float)number * (side * length), square = (float)(number * number);
        const int sure = number < SURE_MOVES;
        FloatRow phase, direct, mpi, direct_by, mpi_by, error, error_of_mpi;
        EACH_PIXEL phase[i] = from[i] + turn;
        answers(g, follow, phase, g->moved, NULL);
        answers(g, follow, at, g->other, g->slope);
        fit_beside(g, follow->rows);
        EACH_PIXEL {
            at[i] = at[i] + g->step[i];
            direct_by[i] = moved ? at[i] - from_other[i] : turn;
            mpi_by[i] = moved ? turn : at[i] - from_other[i];
            direct[i] = moved ? g->amplitude[1][i] : g->amplitude[0][i];
            mpi[i] = moved ? g->amplitude[0][i] : g->amplitude[1][i];
        }
        /* Rule.errors */
        EACH_PIXEL {
            const float order = (gap[i] + mpi_by[i] - direct_by[i]) * sign;
            const int swapped = (direct[i] < least * mpi[i]) | ((mpi[i] >= least * direct[i]) & (order < 0.0f));
            error[i] = fabsf(swapped ? gap[i] + mpi_by[i] : direct_by[i]);
            error_of_mpi[i] = fabsf(swapped ? direct_by[i] - gap[i] : mpi_by[i]);
        }
        EACH_PIXEL {
            const float grown = g->misfit[i] - g->least[i], root = sqrtf(grown > 3.0f ? grown : 3.0f);
            const int alike = (direct[i] > 0.0f) & (mpi[i] > 0.0f) & (grown < 9.0f) & (fabsf(g->step[i]) < 0.15f);
            const float first = error[i] / root, second = error_of_mpi[i] / root, before = g->going[i];
            const int counts = alike & (before > 0.0f), goes_on = sure | alike | (grown < square * usual[i]);
            g->farthest[0][i] = counts & (first > g->farthest[0][i]) ? first : g->farthest[0][i];
            g->farthest[1][i] = counts & (second > g->farthest[1][i]) ? second : g->farthest[1][i];
            g->going[i] = goes_on ? before : 0.0f;
        }
        if (!any_going(g->going)) return;
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
            for (int part = 0; part < 2 * follow->rows; part++) g->phasor[part][i] = follow->phasor[part * n + pixel];
            for (int path = 0; path < 2; path++) {
                g->found[path][i] = follow->found[path * n + pixel];
                g->sigma[path][i] = follow->sigma[path * n + pixel];
            }
            if (follow->phase_rad)
                for (int row = 0; row < follow->rows; row++) g->own[row][i] = follow->phase_rad[row * n + pixel];
            g->per_variance[i] = follow->per_variance[pixel];
        }
        answers(g, follow, g->found[0], g->moved, NULL);
        answers(g, follow, g->found[1], g->other, g->slope);
        fit_beside(g, follow->rows);
        EACH_PIXEL {
            g->least[i] = g->misfit[i];
            g->farthest[0][i] = g->farthest[1][i] = 0.0f;
        }
        for (int moved = 0; moved < 2; moved++)
            for (int side = -1; side <= 1; side += 2) {
                EACH_PIXEL g->going[i] = i < m ? 1.0f : 0.0f;
                follow_to_side(g, follow, moved, (float)side);
            }
        for (int path = 0; path < 2; path++)
            for (int i = 0; i < m; i++) follow->farthest[path * n + start + i] = g->farthest[path][i];
    }
}
