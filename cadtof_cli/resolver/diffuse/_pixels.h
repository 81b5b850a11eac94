/* The answer of a pixel through the model of the tail that its patches give: the operations of these modules, in their order.
 *
 *   pixels.py   data of a pixel, its answer        upsampling.py  from patches to pixels
 *   noise.py    noise of the data                  condition.py   Gaussian conditioning
 *
 * All pixels of a group stand in one row of the frame. So all of them have the same row of patches above and below.
 */
#include "_elementary.h"

#define MOST_HARMONICS 8
#define MOST_DATA (2 * (MOST_HARMONICS - 1))
#define MOST_PLANES (MOST_DATA + 2 + MOST_DATA * (MOST_DATA + 1) / 2 + 2 * MOST_DATA + 1 + 2)

/* Constants of the modules named beside them, where their docstrings are. */
#define LARGEST_AMPLITUDE 1.5f              /* light.py */
#define LEAST_AMPLITUDE_SQUARE 0.01f        /* pixels.py: LEAST_AMPLITUDE; LEAST_HARMONIC is 1 */
#define LEAST_SHARE 0.05f
#define UNKNOWN_PHASE_RAD 1.8137993642342178f
#define USUAL_MISFIT 2.0f                   /* the variance grows where chi^2 exceeds USUAL_MISFIT + MISFIT_PER_DATUM x data */
#define MISFIT_PER_DATUM 1.5f
#define NEAREST_M 0.05f                     /* settings.py */
#define SAME_SURFACE 0.1f                   /* planes.py */
#define EVEN_WEIGHT 1e-3f                   /* upsampling.py */

/* Sizes of the frame and of the planes over its patches. `first` is the flat index of the first pixel in the frame. */
#define TAIL_SIZES(X) X(first) X(height) X(width) X(side) X(left) X(rows) X(columns) X(harmonics)
/* For all pixels: the variance that the tail adds to separate paths, and metres per radian. */
#define TAIL_CONSTANTS(X) X(separate_variance) X(metres)

#define SIZE_MEMBER(name) int64_t name;
#define CONSTANT_MEMBER(name) double name;
typedef struct {
    TAIL_SIZES(SIZE_MEMBER)
} TailSizes;
typedef struct {
    TAIL_CONSTANTS(CONSTANT_MEMBER)
} TailConstants;

typedef struct {
    const TailSizes *sizes;
    const TailConstants *constants;
    const int64_t *number;      /* number of each harmonic */
    const double *variance;     /* noise variance of a channel, for each harmonic */
    const float *planes;        /* planes x rows x columns, see upsampling.py */
    const float *range_m;       /* rows x columns */
    const float *down, *right;  /* for each row and column of pixels: how far it lies from the patch before to the patch after */
    const int64_t *above;       /* for each row of pixels: the row of patches above it */
    const uint8_t *separate;    /* patches with separate paths; NULL: there are none */
    const double *offset_m;     /* added to the range of each pixel; NULL: nothing is added */
} Tail;

/* One pixel per column. re, im, answered and samples come in. */
typedef struct {
    Row re[MOST_HARMONICS], im[MOST_HARMONICS], answered, samples;
    FloatRow part[MOST_HARMONICS][2], square[MOST_HARMONICS];  /* re and im of pixels with an answer, and the sum of their squares */
    FloatRow plane[MOST_PLANES];                 /* at the pixel; later what the data leave of them */
    FloatRow data[MOST_DATA], relative[MOST_HARMONICS], moved[MOST_DATA + 2];
    FloatRow weight[4], right, range_m;
    FloatRow cos, sin, shrink, lag;
    FloatRow amplitude, phase_rad;               /* of p_1 */
    FloatRow direct[3], mpi[3], chi_squared;     /* amplitude, phase, sigma */
} TailGroup;

INLINE int data_of(int harmonics) { return 2 * (harmonics - 1); }

/* The plane of the covariance in row j and column k: coarse.py: needed_entries, in their order after the means. */
INLINE int entry(int data, int j, int k) {
    const int among = data * (data + 1) / 2, means = data + 2;
    if (j < data) return means + j * (j + 1) / 2 + k;
    if (j == data) return means + among + k;
    return means + among + data + (k < data ? k : data);
}

INLINE int planes_of(int data) { return entry(data, data + 1, data + 1) + 3; }

#define FROM(row, source) \
    if (m == GROUP) EACH_PIXEL (row)[i] = (source)[i]; \
    else EACH_PIXEL (row)[i] = (source)[i < m ? i : 0]

/* pixels.py: diffuse_pixels, which pixels get an answer */
INLINE void choose(TailGroup *restrict g, const Tail *restrict tail, int64_t pixel, int m, int harmonics) {
    for (int h = 0; h < harmonics; h++) EACH_PIXEL {
        const float re = (float)g->re[h][i], im = (float)g->im[h][i], square = re * re + im * im;
        g->answered[i] = square < LARGEST_AMPLITUDE * LARGEST_AMPLITUDE ? g->answered[i] : 0.0;
        g->part[h][0][i] = re;
        g->part[h][1][i] = im;
        g->square[h][i] = square;
    }
    EACH_PIXEL g->answered[i] = g->square[0][i] > 0.0f ? g->answered[i] : 0.0;
    if (tail->separate) {
        const int64_t side = tail->sizes->side, y = pixel / tail->sizes->width, x = pixel % tail->sizes->width;
        const uint8_t *separate = tail->separate + y / side * ((tail->sizes->width + side - 1) / side);
        for (int i = 0; i < m; i++) g->answered[i] = separate[(x + i) / side] ? 0.0 : g->answered[i];
    }
    for (int h = 0; h < harmonics; h++) EACH_PIXEL {
        const double answered = g->answered[i];
        g->part[h][0][i] = answered > 0.0 ? g->part[h][0][i] : 1.0f;
        g->part[h][1][i] = answered > 0.0 ? g->part[h][1][i] : 0.0f;
        g->square[h][i] = answered > 0.0 ? g->square[h][i] : 1.0f;
    }
}

/* Noise variance of the phasors of a harmonic: of one recorded pixel, or of a mean over `samples` pixels if pooled. */
INLINE void noise_of(float *restrict variance, const TailGroup *restrict g, double of_one, int pooled) {
    if (pooled) EACH_PIXEL variance[i] = (float)(of_one / g->samples[i]);
    else EACH_PIXEL variance[i] = (float)of_one;
}

/* pixels.py: _pixel_data */
INLINE void look(TailGroup *restrict g, const Tail *restrict tail, int pooled, int harmonics) {
    const int count = harmonics - 1;
    FloatRow variance;
    noise_of(variance, g, tail->variance[0], pooled);
    EACH_PIXEL g->amplitude[i] = sqrtf(g->square[0][i]);
    EACH_PIXEL {
        g->square[0][i] = at_least_f(g->square[0][i], LEAST_AMPLITUDE_SQUARE * variance[i]);
        g->relative[0][i] = variance[i] / g->square[0][i];
    }
    EACH_PIXEL g->phase_rad[i] = phase_of_f(g->part[0][0][i], g->part[0][1][i]);
    for (int h = 1; h < harmonics; h++) {
        float *restrict size = g->data[h - 1], *restrict phase = g->data[count + h - 1];
        const float number = (float)tail->number[h];
        noise_of(variance, g, tail->variance[h], pooled);
        EACH_PIXEL {
            const float power = at_least_f(g->square[h][i], variance[i]);
            size[i] = power / g->square[0][i];
            g->relative[h][i] = variance[i] / power;
        }
        EACH_PIXEL size[i] = 0.5f * logarithm(size[i]);
        EACH_PIXEL phase[i] = phase_of_f(g->part[h][0][i], g->part[h][1][i]) - number * g->phase_rad[i];
    }
}

/* upsampling.py: linear; pixels.py: _first_range */
INLINE void first_range(TailGroup *restrict g, const Tail *restrict tail, int64_t pixel, int m, const float *upper_left) {
    const TailSizes *sizes = tail->sizes;
    const float *lower_left = upper_left + sizes->columns, down = tail->down[pixel / sizes->width];
    const float metres = (float)tail->constants->metres;
    FloatRow a, b, c, d, offset;
    FROM(g->right, tail->right + pixel % sizes->width);
    FROM(a, upper_left);
    FROM(b, upper_left + sizes->side);
    FROM(c, lower_left);
    FROM(d, lower_left + sizes->side);
    if (tail->offset_m) for (int i = 0; i < GROUP; i++) offset[i] = (float)tail->offset_m[pixel + (i < m ? i : 0)];
    else EACH_PIXEL offset[i] = 0.0f;
    EACH_PIXEL {
        const float right = g->right[i], upper = a[i] + right * (b[i] - a[i]);
        const float lag = upper + down * (c[i] + right * (d[i] - c[i]) - upper);
        const float turns = (g->phase_rad[i] - lag) / FULL_TURN_F;
        const float range_m = (turns - floorf(turns)) * FULL_TURN_F * metres + offset[i];
        g->range_m[i] = at_least_f(range_m, NEAREST_M);
    }
}

/* upsampling.py: _weights */
INLINE void weigh(TailGroup *restrict g, const Tail *restrict tail, int64_t pixel, int m, const float *upper_left) {
    const TailSizes *sizes = tail->sizes;
    const float down = tail->down[pixel / sizes->width];
    for (int corner = 0; corner < 4; corner++) {
        const float v = corner < 2 ? 1.0f - down : down;
        float *restrict weight = g->weight[corner];
        FloatRow there;
        FROM(there, upper_left + corner / 2 * sizes->columns + corner % 2 * sizes->side);
        EACH_PIXEL {
            const float u = corner % 2 ? g->right[i] : 1.0f - g->right[i];
            const float apart = (there[i] - g->range_m[i]) * (1.0f / (SAME_SURFACE * g->range_m[i]));
            const float nearness = apart * apart + 1.0f;
            weight[i] = (v * u + EVEN_WEIGHT) / (nearness * nearness);
        }
    }
    EACH_PIXEL {
        const float share = 1.0f / (g->weight[0][i] + g->weight[1][i] + g->weight[2][i] + g->weight[3][i]);
        g->weight[0][i] *= share;
        g->weight[1][i] *= share;
        g->weight[2][i] *= share;
    }
}

/* upsampling.py: joint */
INLINE void upsample(TailGroup *restrict g, const Tail *restrict tail, int64_t place, int m, int planes) {
    const int64_t size = tail->sizes->rows * tail->sizes->columns, side = tail->sizes->side, below = tail->sizes->columns;
    for (int p = 0; p < planes; p++) {
        const float *restrict corner = tail->planes + p * size + place;
        float *restrict to = g->plane[p];
        if (m == GROUP) EACH_PIXEL {
            const float last = corner[below + side + i];
            const float total = (corner[i] - last) * g->weight[0][i] + (corner[side + i] - last) * g->weight[1][i];
            to[i] = total + (corner[below + i] - last) * g->weight[2][i] + last;
        }
        else for (int i = 0; i < GROUP; i++) {
            const int at = i < m ? i : 0;
            const float last = corner[below + side + at];
            const float total = (corner[at] - last) * g->weight[0][i] + (corner[side + at] - last) * g->weight[1][i];
            to[i] = total + (corner[below + at] - last) * g->weight[2][i] + last;
        }
    }
}

/* noise.py: noise_covariance, added to the covariances of the planes */
INLINE void add_noise(TailGroup *restrict g, const Tail *restrict tail, int harmonics) {
    const int count = harmonics - 1, data = 2 * count;
    const float *restrict first = g->relative[0];
    for (int j = 0; j < count; j++) {
        const float h = (float)tail->number[j + 1];
        const float *restrict own = g->relative[j + 1];
        for (int k = 0; k < j; k++) {
            float *restrict sizes = g->plane[entry(data, j, k)], *restrict phases = g->plane[entry(data, count + j, count + k)];
            const float both = (float)(tail->number[j + 1] * tail->number[k + 1]);
            EACH_PIXEL {
                sizes[i] = sizes[i] + first[i];
                phases[i] = phases[i] + first[i] * both;
            }
        }
        float *restrict size = g->plane[entry(data, j, j)], *restrict phase = g->plane[entry(data, count + j, count + j)];
        float *restrict of_size = g->plane[entry(data, data, j)], *restrict of_phase = g->plane[entry(data, data + 1, count + j)];
        EACH_PIXEL {
            size[i] = size[i] + (first[i] + own[i]);
            phase[i] = phase[i] + (first[i] * (h * h) + own[i]);
            of_size[i] = of_size[i] + -first[i];
            of_phase[i] = of_phase[i] + first[i] * -h;
        }
    }
    float *restrict of_lag = g->plane[entry(data, data + 1, data + 1)];
    EACH_PIXEL of_lag[i] = of_lag[i] + first[i];
}

/* condition.py: conditioned. moved[data] and moved[data + 1] are the negative shifts. */
INLINE void condition(TailGroup *restrict g, int harmonics) {
    const int data = data_of(harmonics);
    for (int j = 0; j < data; j++) EACH_PIXEL {
        const float difference = g->data[j][i] - g->plane[j][i];
        g->moved[j][i] = j < data / 2 ? difference : wrapped(difference);
    }
    EACH_PIXEL g->moved[data][i] = g->moved[data + 1][i] = g->chi_squared[i] = 0.0f;
    for (int from = 0; from < data; from++) {
        const float *restrict own = g->plane[entry(data, from, from)], *restrict moved = g->moved[from];
        for (int j = from + 1; j < data + 2; j++) {
            const float *restrict with = g->plane[entry(data, j, from)];
            float *restrict to = g->moved[j];
            FloatRow share;
            EACH_PIXEL {
                share[i] = with[i] / own[i];
                to[i] = to[i] - share[i] * moved[i];
            }
            for (int k = from + 1; k <= j; k++) {
                if (k >= data && !(j == data + 1 && k == j)) continue;
                float *restrict left = g->plane[entry(data, j, k)];
                const float *restrict other = g->plane[entry(data, k, from)];
                EACH_PIXEL left[i] = left[i] - share[i] * other[i];
            }
        }
        EACH_PIXEL g->chi_squared[i] = g->chi_squared[i] + moved[i] * moved[i] / own[i];
    }
}

/* pixels.py: _direct, _mpi */
INLINE void answer(TailGroup *restrict g, int harmonics) {
    const int data = data_of(harmonics), last = planes_of(data) - 1;
    const float *restrict of_lag = g->plane[entry(data, data + 1, data + 1)];
    FloatRow misfit;
    EACH_PIXEL misfit[i] = at_least_f(g->chi_squared[i] / (USUAL_MISFIT + MISFIT_PER_DATUM * (float)data), 1.0f);
    EACH_PIXEL {
        const float variance = at_least_f(of_lag[i], LEAST_SHARE * g->relative[0][i]) + g->plane[last - 1][i];
        g->shrink[i] = exponential(-(g->plane[data][i] + -g->moved[data][i]));
        g->lag[i] = g->plane[data + 1][i] + -g->moved[data + 1][i];
        g->direct[0][i] = g->amplitude[i] * g->shrink[i];
        g->direct[1][i] = within_a_turn(g->phase_rad[i] - g->lag[i]);
        g->direct[2][i] = sqrtf(variance * misfit[i]);
    }
    EACH_PIXEL rotor(g->lag[i], &g->cos[i], &g->sin[i]);
    EACH_PIXEL {
        const float re = 1.0f - g->shrink[i] * g->cos[i], im = g->shrink[i] * g->sin[i];
        const float sigma = sqrtf((at_least_f(g->plane[last][i], 0.0f) + g->relative[0][i]) * misfit[i]);
        g->mpi[0][i] = g->amplitude[i] * sqrtf(re * re + im * im);
        g->mpi[1][i] = g->direct[1][i] + within_a_turn(phase_of_f(re, im) + g->lag[i]);
        g->mpi[2][i] = at_most_f(sigma, UNKNOWN_PHASE_RAD);
    }
}

INLINE void answer_with(TailGroup *restrict g, const Tail *restrict tail, int64_t pixel, int m, int pooled, int harmonics) {
    const TailSizes *sizes = tail->sizes;
    const int data = data_of(harmonics);
    const int64_t place = tail->above[pixel / sizes->width] * sizes->columns + sizes->left + pixel % sizes->width;
    choose(g, tail, pixel, m, harmonics);
    if (!any(g->answered)) return;
    look(g, tail, pooled, harmonics);
    first_range(g, tail, pixel, m, tail->planes + (data + 1) * sizes->rows * sizes->columns + place);
    weigh(g, tail, pixel, m, tail->range_m + place);
    upsample(g, tail, place, m, planes_of(data));
    add_noise(g, tail, harmonics);
    condition(g, harmonics);
    answer(g, harmonics);
}

/* m pixels in one row, from `pixel` of the frame on. */
INLINE void answer_group(TailGroup *restrict g, const Tail *restrict tail, int64_t pixel, int m, int pooled) {
    /* the same call twice: if the number of harmonics is a constant, compilers unroll the loops */
    if (tail->sizes->harmonics == 2) answer_with(g, tail, pixel, m, pooled, 2);
    else answer_with(g, tail, pixel, m, pooled, (int)tail->sizes->harmonics);
}

/* How many pixels form a group, from pixel p of the call on: at most GROUP, and all in one row of the frame. */
INLINE int in_row(const Tail *restrict tail, int64_t p, int64_t stop) {
    const int64_t left = tail->sizes->width - (tail->sizes->first + p) % tail->sizes->width;
    return in_group(stop - p < left ? stop - p : left);
}

#define TAIL_ANSWERS 7

/* Phasors of `pixels` pixels, and their answers, in planes like those of DiffusePixels in records.py. */
typedef struct {
    const Tail *tail;
    const double *phasors;  /* harmonics x pixels, re and im */
    const uint8_t *usable;
    const double *samples;  /* NULL: 1 */
    uint8_t *answered;
    float *rows;            /* direct amplitude, phase and sigma, those of the MPI light, chi^2 */
    int64_t pixels;
} TailAnswers;

INLINE void answer_pixels(const TailAnswers *restrict all) {
    TailGroup group, *g = &group;
    memset(g, 0, sizeof group);
    int m;
    for (int64_t start = 0; start < all->pixels; start += m) {
        m = in_row(all->tail, start, all->pixels);
        for (int64_t h = 0; h < all->tail->sizes->harmonics; h++) {
            const double *phasor = all->phasors + 2 * (h * all->pixels + start);
            for (int i = 0; i < GROUP; i++) {
                g->re[h][i] = phasor[2 * (i < m ? i : 0)];
                g->im[h][i] = phasor[2 * (i < m ? i : 0) + 1];
            }
        }
        for (int i = 0; i < GROUP; i++) g->answered[i] = all->usable[start + (i < m ? i : 0)] ? 1.0 : 0.0;
        if (all->samples) for (int i = 0; i < GROUP; i++) g->samples[i] = all->samples[start + (i < m ? i : 0)];
        answer_group(g, all->tail, all->tail->sizes->first + start, m, all->samples != NULL);
        const float *row[TAIL_ANSWERS] = {g->direct[0], g->direct[1], g->direct[2], g->mpi[0], g->mpi[1], g->mpi[2], g->chi_squared};
        for (int i = 0; i < m; i++) all->answered[start + i] = g->answered[i] > 0.0;
        for (int r = 0; r < TAIL_ANSWERS; r++) {
            float *restrict to = all->rows + r * all->pixels + start;
            for (int i = 0; i < m; i++) to[i] = g->answered[i] > 0.0 ? row[r][i] : NAN;
        }
    }
}
