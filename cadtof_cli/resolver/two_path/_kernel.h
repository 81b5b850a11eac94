/* Stored values -> maps of harmonics 1 and 2, pixel by pixel: the operations of the modules named below, in their order.
 *
 *   phasors/voltages.py                    stored values -> phasors
 *   resolver/resolve.py, order.py          the driver: which pixels get an answer, and how many paths
 *   resolver/returns.py                    which path is direct
 *   resolver/two_path/closed_form.py       two paths            arctangent.py   their phases
 *   resolver/two_path/one_path.py          one path             uncertainty.py  standard deviations
 *   maps/depth.py, layers.py               paths -> maps
 *
 * Those are written to be read; this is written to be fast. Both use nothing but +, -, *, / and square roots, which IEEE 754
 * rounds in one way only, so both give the same bits, whatever the compiler and the machine (test_kernel.py holds them to it).
 * That needs a compiler that neither contracts a*b + c nor reorders: -ffp-contract=off, no -ffast-math.
 *
 * GROUP neighbours stand in short rows that stay in the first-level cache. Each loop holds a few operations for every pixel of
 * a group, so compilers make vector instructions of it; what no pixel of a group needs is left out for the whole group.
 */
#include <float.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

#ifdef __FAST_MATH__
#error "the kernel and its numpy reference give the same bits only without -ffast-math"
#endif
#if !defined(FLT_EVAL_METHOD) || FLT_EVAL_METHOD != 0
#error "the kernel needs arithmetic that rounds every operation to its own type"
#endif

#ifndef GROUP
#define GROUP 32
#endif
#define EACH_PIXEL for (int i = 0; i < GROUP; i++)
#define LAYERS 7

#define PI 3.141592653589793
#define FULL_TURN 6.283185307179586

/* Bits of resolver/status.py that are read or set here; the others go through as they came. */
enum { SATURATED = 1, NOT_FINITE = 2, LOW_CONFIDENCE = 4, ONE_PATH = 8, TWO_PATHS = 16, ILL_CONDITIONED = 32, HOT_PIXEL = 256 };
enum order { ORDER_AUTO, ORDER_ONE, ORDER_TWO };
enum returns { RETURN_FIRST, RETURN_STRONGEST, RETURN_LAST };
enum type { UINT16, INT16, FLOAT32, FLOAT64, PHASORS };

/* What all pixels of a frame share, by the names that kernel.py gives them. */
#define CONSTANTS(X) \
    X(gain1) X(gain2) X(gain3) X(gain4)            /* parts of phasors, re1, im1, re2, im2, from stored values ... */ \
    X(offset1) X(offset2) X(offset3) X(offset4)    /* ... where no pixel has a map of its own */ \
    X(saturated_low) X(saturated_high)             /* stored values at or beyond them are saturated; NaN: none are */ \
    X(per_variance1) X(per_variance2)              /* 1 / dark variance of harmonic h */ \
    X(least_power) X(least_modulus)                /* at and below, and below which there is no signal */ \
    X(misfit_limit) X(misfit_spread)               /* chi^2 above which there are two paths; see may_be_one_path */ \
    X(weight)                                      /* dark variance of harmonic 1 over that of 2 */ \
    X(dark1) X(dark2) X(doubled1) X(doubled2)      /* variance along and across a phasor: dark +- doubled * amplitude ... */ \
    X(averaging1) X(averaging2) X(least1) X(least2)/* ... - averaging * amplitude^2 along it, and at least least */ \
    X(alone0) X(alone1) X(alone2) X(own0) X(own1) X(own2) X(own3) X(own4) X(other0) X(other1) X(other2) X(signal) \
    X(return_ratio)                                /* least amplitude of a direct path over the strongest's */ \
    X(metres) X(volts)                             /* of a radian, of an amplitude of 1 */

#define MEMBER(name) double name;
typedef struct {
    CONSTANTS(MEMBER)
} Constants;

/* A frame of `pixels` pixels. Pointers to what pixels have of their own are NULL where they have not. */
typedef struct {
    const void *stored;      /* 4 planes of `type`; or 2 of complex phasors */
    const Constants *constants;
    const double *own;       /* 4 planes: parts of phasors from the stored values of their own channel, ... */
    const double *other;     /* ... from those of the harmonic's other channel, ... */
    const double *constant;  /* ... and from nothing */
    const double *samples;   /* recorded pixels that a phasor is a mean of */
    const double *metres;    /* of a radian */
    const double *shift;     /* radians to take from every phase */
    float *layers;           /* LAYERS planes */
    uint32_t *status;        /* in: bits known before; out: all */
    int64_t pixels;
    enum type type;
    enum order order;
    enum returns returns;
} Frame;

/* One pixel a column. */
typedef double Row[GROUP];
typedef struct {
    Row re1, im1, re2, im2, unsound, samples, root;      /* phasors; 1 where there must be no answer; samples, their root */
    Row u, pr, pi, cos, sin;                             /* FundamentalFrame */
    Row confidence, refusal, answered, single, may, need;/* bits that refuse an answer; is, may be one path; needs two */
    Row one_amplitude, one_phase, one_sigma, misfit;     /* OnePath; 1 where it leaves more than noise does */
    Row a, b, cos_m, sin_m, cos_half, sin_half;          /* TwoPaths */
    Row x, y, sigma_x, sigma_y, doubtful;
    Row amplitude[2], phase[2], sigma[2];                /* direct and MPI path */
    Row t1, t2, t3, t4, t5;                              /* between the loops of a function */
} Group;

#define INLINE static inline KERNEL_INLINE

INLINE double at_least(double value, double low) { return value < low ? low : value; }   /* numpy.maximum: NaN stays NaN */
INLINE double at_most(double value, double high) { return high < value ? high : value; } /* numpy.minimum */

INLINE int any(const double *restrict row) {
    int64_t found = 0;
    EACH_PIXEL found |= row[i] > 0.0;
    return found != 0;
}

/* arctangent.py: phase_of */
INLINE double phase_of(double cos, double sin) {
    double x = fabs(cos), y = fabs(sin);
    double low = y > x ? x : y, high = y > x ? y : x;
    int far = low > high * 0.41421356237309503;
    double tangent = (far ? low - high : low) / (far ? low + high : high);
    double z = tangent * tangent, series = -0.019176887104237525;
    series = series * z + 0.03923165828348216;
    series = series * z + -0.0508544973752125;
    series = series * z + 0.058581489127221394;
    series = series * z + -0.06664511447372731;
    series = series * z + 0.07692183190825433;
    series = series * z + -0.09090904578123873;
    series = series * z + 0.11111111015256361;
    series = series * z + -0.14285714284666542;
    series = series * z + 0.1999999999999552;
    series = series * z + -0.3333333333333333;
    double phase = tangent + tangent * z * series;
    phase = far ? phase + 0.25 * PI : phase;
    phase = y > x ? 0.5 * PI - phase : phase;
    phase = cos < 0.0 ? PI - phase : phase;
    phase = sin < 0.0 ? FULL_TURN - phase : phase;
    return phase >= FULL_TURN ? 0.0 : phase;
}

/* voltages.py: saturated_pixels, phasors_from_stored. Columns from m on repeat the first. */
#define LOAD(TYPE, VALUE) \
    { \
        const TYPE *stored = frame->stored; \
        if (m == GROUP) EACH_PIXEL value[c][i] = VALUE(i); \
        else EACH_PIXEL value[c][i] = VALUE(i < m ? i : 0); \
    }
#define VOLTAGE(i) (double)stored[c * n + start + (i)]
#define PART(i) stored[2 * ((c / 2) * n + start + (i)) + c % 2]

INLINE void load(Group *restrict g, const Frame *restrict frame, int64_t start, int m) {
    const Constants *k = frame->constants;
    const int64_t n = frame->pixels;
    double *phasor[4] = {g->re1, g->im1, g->re2, g->im2};
    Row value[4];
    for (int c = 0; c < 4; c++) {
        switch (frame->type) {
        case UINT16: LOAD(uint16_t, VOLTAGE) break;
        case INT16: LOAD(int16_t, VOLTAGE) break;
        case FLOAT32: LOAD(float, VOLTAGE) break;
        case FLOAT64: LOAD(double, VOLTAGE) break;
        case PHASORS: LOAD(double, PART) break;
        }
    }
    const uint32_t none = SATURATED | NOT_FINITE | HOT_PIXEL;
    const uint32_t *status = frame->status + start;
    if (m == GROUP) EACH_PIXEL g->unsound[i] = status[i] & none ? 1.0 : 0.0;
    else EACH_PIXEL g->unsound[i] = status[i < m ? i : 0] & none ? 1.0 : 0.0;
    EACH_PIXEL g->refusal[i] = 0.0;
    for (int c = 0; c < 4; c++) EACH_PIXEL {
        double beyond = value[c][i] <= k->saturated_low ? (double)SATURATED : g->refusal[i];
        g->refusal[i] = value[c][i] >= k->saturated_high ? (double)SATURATED : beyond;
    }
    const double gain[4] = {k->gain1, k->gain2, k->gain3, k->gain4};
    const double offset[4] = {k->offset1, k->offset2, k->offset3, k->offset4};
    for (int c = 0; c < 4; c++) {
        double *restrict p = phasor[c];
        if (frame->type == PHASORS) EACH_PIXEL p[i] = value[c][i];
        else if (frame->own) {
            const double *restrict own = frame->own + c * n + start, *restrict other = frame->other + c * n + start;
            const double *restrict constant = frame->constant + c * n + start;
            for (int i = 0; i < m; i++) p[i] = value[c][i] * own[i] + value[c ^ 1][i] * other[i] + constant[i];
            for (int i = m; i < GROUP; i++) p[i] = p[0];
        } else EACH_PIXEL p[i] = value[c][i] * gain[c] + offset[c];
    }
    if (frame->samples) {
        for (int i = 0; i < GROUP; i++) g->samples[i] = frame->samples[start + (i < m ? i : 0)];
        EACH_PIXEL g->root[i] = sqrt(g->samples[i]);
    }
}

/* closed_form.py: fundamental_frame */
INLINE void fundamental_frame(Group *restrict g) {
    EACH_PIXEL {
        double re1 = g->re1[i], im1 = g->im1[i], re2 = g->re2[i], im2 = g->im2[i];
        double u = sqrt(re1 * re1 + im1 * im1), zero = u == 0.0 ? 1.0 : 0.0, inverse = 1.0 / (u + zero);
        double cos = re1 * inverse + zero, sin = im1 * inverse;
        double cos2 = cos * cos - sin * sin, sin2 = 2.0 * (sin * cos);
        g->u[i] = u;
        g->pr[i] = re2 * cos2 + im2 * sin2;
        g->pi[i] = im2 * cos2 - re2 * sin2;
        g->cos[i] = cos;
        g->sin[i] = sin;
    }
}

/* resolve.py: _screened. `refusal` comes in with SATURATED. */
INLINE void screen(Group *restrict g, const Frame *restrict frame) {
    const Constants *k = frame->constants;
    EACH_PIXEL {
        double u = g->u[i], pr = g->pr[i], pi = g->pi[i];
        g->t1[i] = u * u * k->per_variance1 + (pr * pr + pi * pi) * k->per_variance2;
    }
    if (frame->samples) EACH_PIXEL g->t1[i] = g->t1[i] * g->samples[i];
    EACH_PIXEL {
        double u = g->u[i], power = g->t1[i], refusal = g->refusal[i], unsound = g->unsound[i];
        double low = power <= k->least_power ? (double)LOW_CONFIDENCE : 0.0;
        low = u < k->least_modulus ? (double)LOW_CONFIDENCE : low;
        unsound = refusal > 0.0 ? 1.0 : unsound;
        low = unsound > 0.0 ? 0.0 : low;
        int finite = power <= DBL_MAX;
        refusal = finite ? refusal + low : refusal + (double)NOT_FINITE;
        unsound = finite ? unsound : 1.0;
        g->confidence[i] = unsound > 0.0 ? NAN : u;
        g->refusal[i] = refusal;
        unsound = refusal > 0.0 ? 1.0 : unsound;
        g->answered[i] = 1.0 - unsound;
    }
}

/* solver.py: may_be_one_path; closed_form.py: is_single */
INLINE void choose_pixels(Group *restrict g, const Frame *restrict frame) {
    const Constants *k = frame->constants;
    EACH_PIXEL {
        double u = g->u[i], dr = u - g->pr[i], d2 = dr * dr + g->pi[i] * g->pi[i];
        double single = d2 <= 0x1p-100 * (u * u) + 1e-120 ? 1.0 : 0.0;
        g->single[i] = single * g->answered[i];
        g->t1[i] = d2;
        g->t2[i] = k->misfit_limit;
    }
    if (frame->samples) EACH_PIXEL g->t2[i] = k->misfit_limit / g->samples[i];
    if (frame->order == ORDER_ONE) EACH_PIXEL g->may[i] = g->answered[i];
    else if (frame->order == ORDER_TWO) EACH_PIXEL g->may[i] = g->single[i];
    else EACH_PIXEL {
        double may = g->t1[i] <= 2.0 * g->t2[i] * k->misfit_spread ? g->answered[i] : g->single[i];
        g->may[i] = may;
    }
    EACH_PIXEL g->need[i] = g->answered[i] - g->may[i];
}

/* one_path.py: _start. The rotor in t1, t2; the largest curvature there can be in t3. */
INLINE void one_path_start(Group *restrict g, double weight) {
    const double from_second = 4.0 * weight;
    EACH_PIXEL {
        double pr = g->pr[i], pi = g->pi[i], modulus = sqrt(pr * pr + pi * pi), half = 0.5 * modulus;
        g->t1[i] = g->u[i] + from_second * sqrt(half * at_least(modulus + pr, 0.0));
        g->t2[i] = copysign(from_second * sqrt(half * at_least(modulus - pr, 0.0)), pi);
        g->t3[i] = g->u[i] + from_second * modulus;
    }
    EACH_PIXEL {
        double cos = g->t1[i], sin = g->t2[i], norm = 1.0 / sqrt(at_least(cos * cos + sin * sin, DBL_MIN));
        g->t1[i] = cos * norm;
        g->t2[i] = sin * norm;
    }
}

/* one_path.py: a Newton step, and _turn */
INLINE void one_path_step(Group *restrict g, double weight) {
    EACH_PIXEL {
        double cos = g->t1[i], sin = g->t2[i], pr = g->pr[i], pi = g->pi[i];
        double cos2 = cos * cos - sin * sin, sin2 = 2.0 * cos * sin;
        double along1 = g->u[i] * cos, across1 = -g->u[i] * sin;
        double along2 = pr * cos2 + pi * sin2, across2 = pi * cos2 - pr * sin2;
        double slope = across1 + 2.0 * weight * across2, curvature = along1 + 4.0 * weight * along2;
        g->t4[i] = slope / at_least(curvature, 0.1 * g->t3[i]);
    }
    EACH_PIXEL {
        double cos = g->t1[i], sin = g->t2[i], half = 0.5 * g->t4[i], square = half * half, norm = 1.0 / (1.0 + square);
        double cos_turn = (1.0 - square) * norm, sin_turn = 2.0 * half * norm;
        g->t1[i] = cos * cos_turn - sin * sin_turn;
        g->t2[i] = sin * cos_turn + cos * sin_turn;
    }
}

/* one_path.py: one_path; noise.py: one_path_variances */
INLINE void one_path(Group *restrict g, const Frame *restrict frame) {
    const Constants *k = frame->constants;
    const double weight = k->weight, per_weights = 1.0 / (1.0 + weight);
    one_path_start(g, weight);
    if (frame->order == ORDER_ONE)
        for (int step = 0; step < 6; step++) one_path_step(g, weight);
    EACH_PIXEL {
        double cos = g->t1[i], sin = g->t2[i], u = g->u[i], pr = g->pr[i], pi = g->pi[i];
        double cos2 = cos * cos - sin * sin, sin2 = 2.0 * cos * sin;
        double along1 = u * cos, across1 = -u * sin, along2 = pr * cos2 + pi * sin2, across2 = pi * cos2 - pr * sin2;
        double amplitude = at_least((along1 + weight * along2) * per_weights, 0.0), share = at_most(amplitude, 1.0);
        double more1 = k->doubled1 * share, more2 = k->doubled2 * share;
        double t1 = k->dark1 - more1, t2 = k->dark2 - more2;
        double r1 = at_least(k->dark1 + more1 - k->averaging1 * share * share, k->least1);
        double r2 = at_least(k->dark2 + more2 - k->averaging2 * share * share, k->least2);
        double along = r1 + r2, across = 4.0 * t1 + t2, amplitudes = along1 - along2, phases = 2.0 * across1 - across2;
        g->t3[i] = (amplitudes * amplitudes * across + phases * phases * along) / (along * across);
        g->one_amplitude[i] = amplitude;
        g->one_sigma[i] = sqrt(t1 * t2 * across) / (across * amplitude);
        g->t4[i] = cos * g->cos[i] - sin * g->sin[i];
        g->t5[i] = cos * g->sin[i] + sin * g->cos[i];
    }
    EACH_PIXEL g->one_phase[i] = phase_of(g->t4[i], g->t5[i]);
    if (frame->samples) EACH_PIXEL {
        g->t3[i] = g->t3[i] * g->samples[i];
        g->one_sigma[i] = g->one_sigma[i] / g->root[i];
    }
    EACH_PIXEL {
        double misfit = g->t3[i] > k->misfit_limit ? g->may[i] - g->single[i] : 0.0;
        g->misfit[i] = misfit;
        g->need[i] = misfit > 0.0 ? 1.0 : g->need[i];
    }
}

/* closed_form.py: _excess, one of Halley's steps. H in t3. */
INLINE void excess_step(Group *restrict g) {
    EACH_PIXEL {
        double u = g->u[i], linear = g->t2[i], h = g->t3[i];
        double value = ((h + 3.0 * u) * h + linear) * h - g->t1[i];
        double slope = (h + (u + u)) * (3.0 * h) + linear, half_curvature = 3.0 * (h + u);
        g->t3[i] = h - value * slope / (slope * slope - value * half_curvature);
    }
}

/* closed_form.py: _excess. H in t3, |d|^2 in t4. */
INLINE void excess(Group *restrict g) {
    EACH_PIXEL {
        double u = g->u[i], pi = g->pi[i], dr = u - g->pr[i], d2 = dr * dr + pi * pi, modulus = sqrt(d2);
        g->t1[i] = u * d2;
        g->t2[i] = 2.0 * (u * dr) - d2;
        g->t3[i] = (modulus + (u + u)) * d2 / ((3.0 * modulus + dr) * u + d2);
        g->t4[i] = d2;
    }
    /* not a loop: compilers would turn it inside out */
    excess_step(g);
    excess_step(g);
    excess_step(g);
}

/* closed_form.py: two_paths */
INLINE void two_paths(Group *restrict g) {
    excess(g);
    EACH_PIXEL {
        double u = g->u[i], pi = g->pi[i], dr = u - g->pr[i], d2 = g->t4[i];
        double single = d2 <= 0x1p-100 * (u * u) + 1e-120 ? 1.0 : 0.0, h = single > 0.0 ? 0.0 : g->t3[i];
        double p0 = u + h, product = (p0 + u) * h, re = p0 * dr - u * h, im = p0 * pi;
        double double_square = product + fabs(re), norm = 1.0 / sqrt(2.0 * product * double_square);
        double large = double_square * norm, small = im * norm;
        double cos_m = re >= 0.0 ? large : small, sin_m = re >= 0.0 ? small : large;
        g->t1[i] = p0;
        g->t2[i] = single;
        g->cos_m[i] = cos_m;
        g->sin_m[i] = sin_m;
        g->cos_half[i] = ((h + dr) * cos_m + pi * sin_m) * u * (norm * large);
    }
    EACH_PIXEL {
        double u = g->u[i], p0 = g->t1[i], single = g->t2[i], cos = g->cos[i], sin = g->sin[i];
        double cos_m = g->cos_m[i], sin_m = g->sin_m[i], cos_half = g->cos_half[i];
        double sin_half = sqrt(at_least((1.0 - cos_half) * (1.0 + cos_half), 1e-300));
        double split = single > 0.0 ? u : sin_m * u / sin_half;
        split = at_least(at_most(split, p0), -p0);
        cos_m = single > 0.0 ? 1.0 : cos_m;
        sin_m = single > 0.0 ? 0.0 : sin_m;
        g->a[i] = 0.5 * (p0 + split);
        g->b[i] = 0.5 * (p0 - split);
        g->cos_m[i] = cos_m * cos + sin_m * sin;
        g->sin_m[i] = cos_m * sin - sin_m * cos;
        g->cos_half[i] = single > 0.0 ? 1.0 : cos_half;
        g->sin_half[i] = single > 0.0 ? 0.0 : sin_half;
    }
}

/* uncertainty.py: two_path_sigmas, in float as there */
typedef struct {
    float cos, alone, own, other, signal, scale;
} VarianceTerms;

INLINE double sigma(float strength, float rival, VarianceTerms t) {
    float excess = rival - strength * (1.0f + t.cos);
    float variance = strength * t.own + rival * t.other + t.alone - excess * excess * t.signal;
    variance = variance < 0.0f ? 0.0f : variance;
    return (double)(sqrtf(variance) / (strength * t.scale));
}

INLINE void two_path_sigmas(Group *restrict g, const Frame *restrict frame) {
    const Constants *k = frame->constants;
    const float alone0 = (float)k->alone0, alone1 = (float)k->alone1, alone2 = (float)k->alone2;
    const float own0 = (float)k->own0, own1 = (float)k->own1, own2 = (float)k->own2, own3 = (float)k->own3;
    const float own4 = (float)k->own4, signal = (float)k->signal;
    const float other0 = (float)k->other0, other1 = (float)k->other1, other2 = (float)k->other2;
    EACH_PIXEL {
        float gap = (float)(2.0 * g->sin_half[i] * g->sin_half[i]), a = (float)g->a[i], b = (float)g->b[i], c = 1.0f - gap;
        VarianceTerms t = {
            c,
            (alone2 * c + alone1) * c + alone0,
            (((own4 * c + own3) * c + own2) * c + own1) * c + own0,
            (other2 * c + other1) * c + other0,
            gap * (1.0f + c) * signal,
            gap * (2.0f + c),
        };
        g->sigma_x[i] = sigma(a, b, t);
        g->sigma_y[i] = sigma(b, a, t);
    }
    EACH_PIXEL {
        double x = g->sigma_x[i], y = g->sigma_y[i], most = x < y ? y : x;
        most = y == y ? most : y;
        /* doubt, most / sin_half, is above 1 just where this is, in floating point too */
        g->doubtful[i] = most > g->sin_half[i] ? (double)ILL_CONDITIONED : 0.0;
        g->t1[i] = most;
    }
    if (frame->samples) EACH_PIXEL {
        g->doubtful[i] = g->t1[i] / g->sin_half[i] / g->root[i] > 1.0 ? (double)ILL_CONDITIONED : 0.0;
        g->sigma_x[i] = g->sigma_x[i] / g->root[i];
        g->sigma_y[i] = g->sigma_y[i] / g->root[i];
    }
}

/* closed_form.py: TwoPaths.phases */
INLINE void phases(Group *restrict g) {
    EACH_PIXEL g->t1[i] = phase_of(g->cos_m[i], g->sin_m[i]);
    EACH_PIXEL g->t2[i] = phase_of(g->cos_half[i], g->sin_half[i]);
    EACH_PIXEL {
        double x = g->t1[i] + g->t2[i], y = g->t1[i] - g->t2[i];
        y = y < 0.0 ? y + FULL_TURN : y;
        g->x[i] = x >= FULL_TURN ? x - FULL_TURN : x;
        g->y[i] = y >= FULL_TURN ? 0.0 : y;
    }
}

/* returns.py: _pair. x_chosen in t1, x_wraps in t2, y_wraps in t3. */
INLINE void direct_and_mpi(Group *restrict g, const Frame *restrict frame) {
    const double ratio = frame->constants->return_ratio, first = frame->returns == RETURN_FIRST ? 1.0 : 0.0;
    EACH_PIXEL {
        double a = g->a[i], b = g->b[i], lead = g->y[i] - g->x[i];
        double x_wraps = lead > 0.5 * FULL_TURN ? 1.0 : 0.0, y_wraps = lead < -0.5 * FULL_TURN ? 1.0 : 0.0;
        g->t2[i] = a < 0.5 * b ? x_wraps : 0.0;
        g->t3[i] = b < 0.5 * a ? y_wraps : 0.0;
    }
    if (frame->returns == RETURN_STRONGEST) EACH_PIXEL g->t1[i] = g->a[i] < g->b[i] ? 0.0 : 1.0;
    else EACH_PIXEL {
        double a = g->a[i], b = g->b[i], lead = g->y[i] - g->x[i];
        double before = lead >= 0.0 ? 1.0 - g->t2[i] : 0.0;
        before = g->t3[i] > 0.0 ? 1.0 : before;
        double wanted = before == first ? 1.0 : 0.0, chosen = a >= ratio * b ? wanted : 0.0;
        g->t1[i] = b >= ratio * a ? chosen : 1.0;
    }
    EACH_PIXEL {
        double chosen = g->t1[i], behind = chosen > 0.0 ? g->t3[i] : g->t2[i], later = chosen > 0.0 ? g->y[i] : g->x[i];
        g->amplitude[0][i] = chosen > 0.0 ? g->a[i] : g->b[i];
        g->amplitude[1][i] = chosen > 0.0 ? g->b[i] : g->a[i];
        g->phase[0][i] = chosen > 0.0 ? g->x[i] : g->y[i];
        g->phase[1][i] = behind > 0.0 ? later + FULL_TURN : later;
        g->sigma[0][i] = chosen > 0.0 ? g->sigma_x[i] : g->sigma_y[i];
        g->sigma[1][i] = chosen > 0.0 ? g->sigma_y[i] : g->sigma_x[i];
    }
}

/* order.py: worth_another, _kept; resolve.py: _bits */
INLINE void decide(Group *restrict g) {
    EACH_PIXEL {
        double difference = fabs(g->phase[0][i] - g->one_phase[i]), two = g->sigma[0][i], one = g->one_sigma[i];
        difference = at_most(difference, FULL_TURN - difference);
        double worth = difference * difference > 2.0 * (two * two - one * one) ? 1.0 : 0.0;
        g->t1[i] = g->may[i] * (1.0 - g->misfit[i] * worth);
    }
    EACH_PIXEL {
        double alone = g->t1[i], no_direct = g->answered[i] > 0.0 ? 0.0 : 1.0, no_mpi = alone > 0.0 ? 1.0 : no_direct;
        double amplitude = alone > 0.0 ? g->one_amplitude[i] : g->amplitude[0][i];
        double phase = alone > 0.0 ? g->one_phase[i] : g->phase[0][i];
        double deviation = alone > 0.0 ? g->one_sigma[i] : g->sigma[0][i];
        g->amplitude[0][i] = no_direct > 0.0 ? NAN : amplitude;
        g->phase[0][i] = no_direct > 0.0 ? NAN : phase;
        g->sigma[0][i] = no_direct > 0.0 ? NAN : deviation;
        g->amplitude[1][i] = no_mpi > 0.0 ? NAN : g->amplitude[1][i];
        g->phase[1][i] = no_mpi > 0.0 ? NAN : g->phase[1][i];
        g->sigma[1][i] = no_mpi > 0.0 ? NAN : g->sigma[1][i];
    }
    EACH_PIXEL {
        double bits = fabs(g->amplitude[0][i]) <= DBL_MAX ? (double)ONE_PATH : 0.0;
        bits = fabs(g->amplitude[1][i]) <= DBL_MAX ? (double)TWO_PATHS + g->doubtful[i] : bits;
        g->refusal[i] = g->refusal[i] + bits;
    }
}

/* layers.py, depth.py: write_block. NaN is written as the one quiet NaN without a sign. */
INLINE void store_layer(const double *restrict values, float *restrict to, int m) {
    float out[GROUP];
    EACH_PIXEL out[i] = (float)(values[i] == values[i] ? values[i] : NAN);
    if (m == GROUP) memcpy(to, out, sizeof out);
    else memcpy(to, out, (size_t)m * sizeof *out);
}

INLINE void store(Group *restrict g, const Frame *restrict frame, int64_t start, int m) {
    const double volts = frame->constants->volts;
    const int64_t n = frame->pixels;
    float *layers = frame->layers + start;
    if (frame->shift) {
        for (int i = 0; i < GROUP; i++) g->t1[i] = frame->shift[start + (i < m ? i : 0)];
        for (int path = 0; path < 2; path++) EACH_PIXEL {
            double phase = g->phase[path][i] - g->t1[i];
            g->phase[path][i] = phase < 0.0 ? phase + FULL_TURN : phase;
        }
    }
    if (frame->metres)
        for (int i = 0; i < GROUP; i++) g->t2[i] = frame->metres[start + (i < m ? i : 0)];
    else EACH_PIXEL g->t2[i] = frame->constants->metres;
    for (int path = 0; path < 2; path++) {
        EACH_PIXEL g->t3[i] = g->phase[path][i] * g->t2[i];
        store_layer(g->t3, layers + path * n, m);
        EACH_PIXEL g->t3[i] = g->amplitude[path][i] * volts;
        store_layer(g->t3, layers + (2 + path) * n, m);
        EACH_PIXEL g->t3[i] = g->sigma[path][i] * g->t2[i];
        store_layer(g->t3, layers + (4 + path) * n, m);
    }
    EACH_PIXEL g->t3[i] = g->confidence[i] * volts;
    store_layer(g->t3, layers + 6 * n, m);
    uint32_t *restrict status = frame->status + start;
    if (m == GROUP) EACH_PIXEL status[i] |= (uint32_t)(int32_t)g->refusal[i];
    else for (int i = 0; i < m; i++) status[i] |= (uint32_t)(int32_t)g->refusal[i];
}

/* Every pixel from `start` up to `stop`. */
INLINE void resolve_pixels(const Frame *restrict frame, int64_t start, int64_t stop) {
    Group group, *g = &group;
    memset(g, 0, sizeof group);
    for (; start < stop; start += GROUP) {
        const int m = stop - start < GROUP ? (int)(stop - start) : GROUP;
        load(g, frame, start, m);
        fundamental_frame(g);
        screen(g, frame);
        choose_pixels(g, frame);
        if (any(g->may)) one_path(g, frame);
        else EACH_PIXEL g->misfit[i] = 0.0;
        if (any(g->need)) {
            two_paths(g);
            two_path_sigmas(g, frame);
            phases(g);
            direct_and_mpi(g, frame);
        }
        decide(g);
        store(g, frame, start, m);
    }
}
