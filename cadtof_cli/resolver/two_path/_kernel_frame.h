/* Stored values -> maps for harmonics 1 and 2, pixel by pixel. The kernel does the operations of these modules, in
 * their order:
 *
 *   phasors/voltages.py                    stored values -> phasors
 *   resolver/resolve.py, order.py          the driver: which pixels get an answer, and how many paths
 *   resolver/returns.py                    which path is direct
 *   resolver/two_path/closed_form.py       two paths            arcsine.py      their phases
 *   resolver/two_path/one_path.py          one path             uncertainty.py  standard deviations
 *   resolver/two_path/roots.py             inverse square roots
 *   maps/depth.py, layers.py               paths -> maps, and amplitudes that no light can have
 *   resolver/diffuse/                      the tail of diffuse MPI: _pixels.h
 *
 * The Python modules are written to be read; the kernel is written to be fast. Both use only +, -, *, / and square
 * roots, which IEEE 754 rounds in exactly one way, and the bits of a number. So both give the same bits, with any
 * compiler on any machine; tests/resolver/two_path/test_kernel.py compares them. This needs a compiler that neither
 * contracts a*b + c nor reorders: -ffp-contract=off, no -ffast-math.
 *
 * GROUP neighbouring pixels stand in short rows, which stay in the first-level cache. Each loop does a few operations
 * for every pixel of a group, so compilers vectorise it. Work that no pixel of a group needs is skipped for the whole
 * group. In most groups every pixel gets an answer: a quick test of their values finds these groups, which then skip
 * the screening of pixels.
 */
#include "../diffuse/_pixels.h"

#define LAYERS 7

/* Bits of resolver/status.py that are read or set here; other bits are passed through unchanged. */
enum { SATURATED = 1, NOT_FINITE = 2, LOW_CONFIDENCE = 4, ONE_PATH = 8, TWO_PATHS = 16, ILL_CONDITIONED = 32, HOT_PIXEL = 256 };
enum { CALIBRATED = 64, MORE_PATHS = 512, POOLED = 1024, DIFFUSE_MPI = 2048, IMPOSSIBLE = 4096 };
enum order { ORDER_AUTO, ORDER_ONE, ORDER_TWO };
enum returns { RETURN_FIRST, RETURN_STRONGEST, RETURN_LAST };
enum type { TYPE_UINT16, TYPE_INT16, TYPE_FLOAT32, TYPE_FLOAT64, TYPE_PHASORS };

/* Constants that all pixels of a frame share, by the names that kernel.py gives them. */
#define CONSTANTS(X) \
    X(gain1) X(gain2) X(gain3) X(gain4)            /* from stored values to the parts re1, im1, re2, im2 of phasors ... */ \
    X(offset1) X(offset2) X(offset3) X(offset4)    /* ... if all pixels share one map */ \
    X(saturated_low) X(saturated_high)             /* stored values at or beyond them are saturated; NaN: no limit */ \
    X(per_variance1) X(per_variance2)              /* 1 / dark variance of harmonic h */ \
    X(least_power) X(least_modulus)                /* no signal if power <= least_power or |p1| < least_modulus */ \
    X(misfit_limit) X(misfit_spread)               /* chi^2 above which there are two paths; see may_be_one_path */ \
    X(weight)                                      /* dark variance of harmonic 1 over that of 2 */ \
    X(dark1) X(dark2) X(doubled1) X(doubled2)      /* variance along and across a phasor: dark +- doubled * amplitude ... */ \
    X(averaging1) X(averaging2) X(least1) X(least2)/* ... - averaging * amplitude^2 along it, and at least least */ \
    X(alone0) X(alone1) X(alone2) X(own0) X(own1) X(own2) X(own3) X(own4) X(other0) X(other1) X(other2) X(signal) \
    X(return_ratio)                                /* smallest amplitude of a direct path over the strongest amplitude */ \
    X(metres) X(volts)                             /* metres per radian, volts per amplitude of 1 */ \
    X(most_volts) X(noise_volts)                   /* paths beyond most_volts + noise_volts / sqrt(samples) are impossible */

#define MEMBER(name) double name;
typedef struct {
    CONSTANTS(MEMBER)
} Constants;

/* A frame of `pixels` pixels. A pointer to values per pixel is NULL if the pixels have no values of their own. */
typedef struct {
    const void *stored;      /* 4 planes of `type`; or 2 of complex phasors */
    const Constants *constants;
    const double *own;       /* 4 planes: factor of the stored value of a part's own channel, ... */
    const double *other;     /* ... factor of the value of the harmonic's other channel, ... */
    const double *constant;  /* ... and offset */
    const double *samples;   /* number of recorded pixels that a phasor is a mean of */
    const double *metres;    /* metres per radian */
    const double *shift;     /* radians to subtract from every phase */
    const Tail *tail;        /* model of the frame's diffuse MPI; NULL: none */
    float *layers;           /* LAYERS planes */
    uint32_t *status;        /* in: bits known before, if `bits` is -1; out: all bits */
    int32_t bits;            /* bits known before, the same for every pixel; -1: they are in `status` */
    int64_t pixels;
    enum type type;
    enum order order;
    enum returns returns;
} Frame;

typedef struct {
    _Alignas(64) Row re1;                                /* rows begin at cache lines, so that no vector crosses two lines */
    Row im1, re2, im2, unsound, samples, root;           /* phasors; 1: must get no answer; samples and their root */
    Row power, inverse;                                  /* |p1|^2 and 1/|p1|; of the next group while this one is in work */
    Row u, pr, pi, cos, sin, d2;                         /* FundamentalFrame, and |d|^2 */
    Row confidence, refusal, answered, single, may;      /* refusal: status bits; single, may: is one path, may be one path */
    Row one_amplitude, one_phase, one_sigma, fall_off;   /* OnePath; fall_off: its doubt */
    Row amplitudes, phases;                              /* disagreement of the harmonics of one path */
    Row misfit;                                          /* 1: one path leaves more misfit than noise explains */
    Row a, b, cos_m, sin_m, cos_half, sin_half;          /* TwoPaths */
    Row x, y, sigma_x, sigma_y, doubtful;
    Row amplitude[2], phase[2], sigma[2];                /* direct path and MPI path */
    Row impossible;                                      /* 1: the amplitudes exceed the modulation amplitude */
    Row t1, t2, t3, t4, t5;                              /* temporary values between the loops of a function */
    int singles, ones, pairs, cleared;                   /* 1 if any pixel is single, may have one path, has two, is impossible */
    Row predicted;                                       /* 1: the answer comes from the tail, ... */
    TailGroup tail;                                      /* ... which is here */
} Group;

/* Prefetch the memory of a full group that comes soon: a frame has too many planes for a processor to predict the
 * access. */
INLINE void fetch(const Frame *restrict frame, int64_t start) {
    static const int BYTES[] = {[TYPE_UINT16] = 2, [TYPE_INT16] = 2, [TYPE_FLOAT32] = 4, [TYPE_FLOAT64] = 8, [TYPE_PHASORS] = 8};
    const int64_t n = frame->pixels;
    if (n - start < GROUP) return;
    for (int c = 0; c < 4; c++) FETCH((const char *)frame->stored + (c * n + start) * BYTES[frame->type]);
    for (int i = 0; i < GROUP; i += 16) {
        for (int layer = 0; layer < LAYERS; layer++) FETCH_TO_WRITE(frame->layers + layer * n + start + i);
        FETCH_TO_WRITE(frame->status + start + i);
    }
}

/* A limit of saturation rounded down to an integer. NaN, which means no limit, becomes a number that 16 bits never
 * reach. */
INLINE int32_t whole(double limit) { return limit > -1e9 ? limit < 1e9 ? (int32_t)floor(limit) : 1000000000 : -1000000000; }

/* Return 1 from is_sound if every stored value of a full group lies from BELOW to ABOVE, and 0 if any does not. If
 * no value of TYPE, which goes from LEAST to MOST, lies there, return 0 at once. */
#define RETURN_IS_WITHIN(TYPE, LEAST, MOST, BELOW, ABOVE) \
    { \
        const TYPE *stored = (const TYPE *)frame->stored + start; \
        if (BELOW > MOST || ABOVE < LEAST) return 0; \
        const TYPE low = BELOW < LEAST ? LEAST : (TYPE)BELOW, high = ABOVE > MOST ? MOST : (TYPE)ABOVE; \
        TYPE beyond = 0; \
        EACH_PIXEL { \
            TYPE least = MOST, most = LEAST; \
            for (int c = 0; c < 4; c++) { \
                const TYPE value = stored[c * n + i]; \
                least = value < least ? value : least; \
                most = value > most ? value : most; \
            } \
            beyond |= (least < low) | (most > high); \
        } \
        return !beyond; \
    }

/* Return 1 if every pixel of this full group can be resolved: none is saturated, and no status bit known before forbids
 * an answer. */
INLINE int is_sound(const Frame *restrict frame, int64_t start) {
    const double low = frame->constants->saturated_low, high = frame->constants->saturated_high;
    const float low_f = (float)low, high_f = (float)high;
    const int32_t below = whole(low) + 1, above = -whole(-high) - 1;
    const int64_t n = frame->pixels;
    uint32_t known = 0;
    if (frame->bits >= 0) known = (uint32_t)frame->bits;
    else EACH_PIXEL known |= frame->status[start + i];
    if (known & (SATURATED | NOT_FINITE | HOT_PIXEL)) return 0;
    if (frame->type == TYPE_UINT16) RETURN_IS_WITHIN(uint16_t, 0, UINT16_MAX, below, above)
    if (frame->type == TYPE_INT16) RETURN_IS_WITHIN(int16_t, INT16_MIN, INT16_MAX, below, above)
    if (frame->type != TYPE_FLOAT32) return 0;
    const float *stored = (const float *)frame->stored + start;
    int32_t beyond = 0;
    EACH_PIXEL {
        float least = INFINITY, most = -INFINITY;
        for (int c = 0; c < 4; c++) {
            const float value = stored[c * n + i];
            least = value < least ? value : least;
            most = value > most ? value : most;
        }
        beyond |= (least <= low_f) | (most >= high_f);
    }
    return !beyond;
}

/* voltages.py: saturated_pixels, phasors_from_stored, for a group that `is_sound`, if all pixels share one map. */
#define LOAD_SOUND(TYPE) \
    { \
        const TYPE *stored = (const TYPE *)frame->stored + start; \
        for (int c = 0; c < 4; c++) \
            EACH_PIXEL phasor[c][i] = (double)stored[c * n + i] * gain[c] + offset[c]; \
    }

INLINE void load_sound(Group *restrict g, const Frame *restrict frame, int64_t start) {
    const Constants *k = frame->constants;
    const int64_t n = frame->pixels;
    double *phasor[4] = {g->re1, g->im1, g->re2, g->im2};
    const double gain[4] = {k->gain1, k->gain2, k->gain3, k->gain4};
    const double offset[4] = {k->offset1, k->offset2, k->offset3, k->offset4};
    if (frame->type == TYPE_UINT16) LOAD_SOUND(uint16_t)
    else if (frame->type == TYPE_INT16) LOAD_SOUND(int16_t)
    else LOAD_SOUND(float)
}

/* The same for any group of m pixels. Columns from m on repeat the first column. */
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
        case TYPE_UINT16: LOAD(uint16_t, VOLTAGE) break;
        case TYPE_INT16: LOAD(int16_t, VOLTAGE) break;
        case TYPE_FLOAT32: LOAD(float, VOLTAGE) break;
        case TYPE_FLOAT64: LOAD(double, VOLTAGE) break;
        case TYPE_PHASORS: LOAD(double, PART) break;
        }
    }
    const uint32_t none = SATURATED | NOT_FINITE | HOT_PIXEL;
    uint32_t *status = frame->status + start;
    if (frame->bits >= 0)
        for (int i = 0; i < m; i++) status[i] = (uint32_t)frame->bits;
    if (m == GROUP) EACH_PIXEL g->unsound[i] = status[i] & none ? 1.0 : 0.0;
    else EACH_PIXEL g->unsound[i] = status[i < m ? i : 0] & none ? 1.0 : 0.0;
    EACH_PIXEL {
        double least = INFINITY, most = -INFINITY;
        for (int c = 0; c < 4; c++) {
            least = value[c][i] < least ? value[c][i] : least;
            most = value[c][i] > most ? value[c][i] : most;
        }
        g->refusal[i] = (least <= k->saturated_low) | (most >= k->saturated_high) ? (double)SATURATED : 0.0;
    }
    const double gain[4] = {k->gain1, k->gain2, k->gain3, k->gain4};
    const double offset[4] = {k->offset1, k->offset2, k->offset3, k->offset4};
    for (int c = 0; c < 4; c++) {
        double *restrict p = phasor[c];
        if (frame->type == TYPE_PHASORS) EACH_PIXEL p[i] = value[c][i];
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

/* depth.py: write_block. Every NaN is written as the same quiet NaN without a sign. With `finite`, values are finite or
 * that NaN already. */
INLINE float written(double value, double scale, int finite) {
    const float out = (float)(value * scale);
    return finite || out == out ? out : NAN;
}

INLINE void store_layer(const double *restrict values, const double *restrict scale, float *restrict to, int m, int finite) {
    if (finite) EACH_PIXEL to[i] = written(values[i], scale[i], 1);
    else if (m == GROUP) EACH_PIXEL to[i] = written(values[i], scale[i], 0);
    else for (int i = 0; i < m; i++) to[i] = written(values[i], scale[i], 0);
}

INLINE void store_none(float *restrict to, int m) {
    if (m == GROUP) EACH_PIXEL to[i] = NAN;
    else for (int i = 0; i < m; i++) to[i] = NAN;
}

/* Write the layers and the status of m pixels. `finite`: every value of this full group is finite or NAN itself, and
 * the scales are finite. `loaded`: `load` has filled status already; load_sound leaves status alone. */
INLINE void store(Group *restrict g, const Frame *restrict frame, int64_t start, int m, int finite, int loaded) {
    const double volts = frame->constants->volts;
    const int64_t n = frame->pixels;
    float *layers = frame->layers + start;
    if (frame->shift) {
        for (int i = 0; i < GROUP; i++) g->t1[i] = frame->shift[start + (i < m ? i : 0)];
        for (int path = 0; path < 1 + g->pairs; path++) EACH_PIXEL {
            double phase = g->phase[path][i] - g->t1[i];
            g->phase[path][i] = phase < 0.0 ? phase + FULL_TURN : phase;
        }
    }
    if (frame->metres)
        for (int i = 0; i < GROUP; i++) g->t2[i] = frame->metres[start + (i < m ? i : 0)];
    else EACH_PIXEL g->t2[i] = frame->constants->metres;
    EACH_PIXEL g->t3[i] = volts;
    for (int path = 0; path < 1 + g->pairs; path++) {
        store_layer(g->phase[path], g->t2, layers + path * n, m, finite);
        store_layer(g->amplitude[path], g->t3, layers + (2 + path) * n, m, finite);
        store_layer(g->sigma[path], g->t2, layers + (4 + path) * n, m, 0);
    }
    if (!g->pairs)
        for (int layer = 1; layer < 6; layer += 2) store_none(layers + layer * n, m);
    store_layer(g->confidence, g->t3, layers + 6 * n, m, finite);
    uint32_t *restrict status = frame->status + start;
    if (!loaded && frame->bits >= 0) EACH_PIXEL status[i] = (uint32_t)(frame->bits | (int32_t)g->refusal[i]);
    else if (m == GROUP) EACH_PIXEL status[i] |= (uint32_t)(int32_t)g->refusal[i];
    else for (int i = 0; i < m; i++) status[i] |= (uint32_t)(int32_t)g->refusal[i];
    if (g->cleared)
        for (int i = 0; i < m; i++)
            if (g->impossible[i] > 0.0) status[i] = (status[i] & (CALIBRATED | POOLED)) | IMPOSSIBLE;
}
