/* The equations of the kernel. The comment of each function names its Python twin; see _kernel_frame.h. */
#include "_kernel_frame.h"

/* roots.py */
INLINE double rough_inverse_root(double x) {
    uint64_t bits;
    double y;
    memcpy(&bits, &x, sizeof bits);
    bits = 0x5fe6eb50c7b537a9u - (bits >> 1);
    memcpy(&y, &bits, sizeof y);
    double square = x * y * y;
    return y * (1.876598 - square * (1.2521 - square * 0.375502));
}

INLINE double nearer_inverse_root(double x, double y) {
    double rest = 1.0 - x * y * y;
    return y + y * rest * (0.5 + rest * (0.375 + rest * 0.3125));
}

INLINE double inverse_root(double x) { return nearer_inverse_root(x, rough_inverse_root(x)); }

INLINE double inverse_root_or_none(double x) { return x < DBL_MIN ? 0.0 : inverse_root(x); }

/* closed_form.py: fundamental_frame, and |d|^2 */
typedef struct {
    double u, pr, pi, cos, sin, d2;
} Turned;

INLINE Turned turned(double re2, double im2, double u, double cos, double sin) {
    double cos2 = cos * cos - sin * sin, sin2 = 2.0 * (sin * cos);
    double pr = re2 * cos2 + im2 * sin2, pi = im2 * cos2 - re2 * sin2, dr = u - pr;
    return (Turned){u, pr, pi, cos, sin, dr * dr + pi * pi};
}

INLINE void put(Group *restrict g, int i, Turned t) {
    g->u[i] = t.u;
    g->pr[i] = t.pr;
    g->pi[i] = t.pi;
    g->cos[i] = t.cos;
    g->sin[i] = t.sin;
    g->d2[i] = t.d2;
}

INLINE void fundamental_frame(Group *restrict g) {
    EACH_PIXEL {
        double re1 = g->re1[i], im1 = g->im1[i], power = re1 * re1 + im1 * im1, inverse = inverse_root_or_none(power);
        double cos = power < DBL_MIN ? 1.0 : re1 * inverse;
        put(g, i, turned(g->re2[i], g->im2[i], power * inverse, cos, im1 * inverse));
    }
}

INLINE double power_of(double u, double pr, double pi, const Constants *restrict k) {
    return u * u * k->per_variance1 + (pr * pr + pi * pi) * k->per_variance2;
}

INLINE int is_single(double u, double d2) { return d2 <= 0x1p-100 * (u * u) + 1e-100; }

/* |d|^2 up to which a pixel may have one path; see solver.py: may_be_one_path */
INLINE double one_path_limit(const Frame *restrict frame) {
    const Constants *k = frame->constants;
    const double limit = 2.0 * k->misfit_limit * k->misfit_spread;
    return frame->order == ORDER_ONE ? INFINITY : frame->order == ORDER_TWO ? -1.0 : limit;
}

/* closed_form.py: fundamental_frame. |p1|^2, and 1/|p1| in two steps. */
INLINE void begin_inverse(Group *restrict g, int i) {
    double re1 = g->re1[i], im1 = g->im1[i];
    g->power[i] = re1 * re1 + im1 * im1;
    g->inverse[i] = rough_inverse_root(g->power[i]);
}

INLINE void end_inverse(Group *restrict g, int i) { g->inverse[i] = nearer_inverse_root(g->power[i], g->inverse[i]); }

/* Do fundamental_frame, screen and choose_pixels in one loop, for a group in which every pixel certainly gets an answer
 * and no pixel is single. Return 1 if the group is such a group; otherwise its rows must be computed again. A pixel
 * gets an answer if |p1|^2 >= `least`, for any p2. With |p1|^2 + |d|^2 <= 16, the limit 2^-95 on |d|^2 is above
 * rounding, and all later values are finite. |p1|^2 and its inverse root are known already. */
INLINE int all_answered(Group *restrict g, const Frame *restrict frame, double least) {
    const double limit = one_path_limit(frame);
    int64_t ones = 0, doubtful = 0;
    EACH_PIXEL {
        double re1 = g->re1[i], im1 = g->im1[i], power = g->power[i], inverse = g->inverse[i];
        Turned t = turned(g->re2[i], g->im2[i], power * inverse, re1 * inverse, im1 * inverse);
        int may = t.d2 <= limit, plain = (power >= least) & (t.d2 >= 0x1p-95) & (power + t.d2 <= 16.0);
        doubtful |= !plain;
        ones += may;
        put(g, i, t);
        g->may[i] = may ? 1.0 : 0.0;
        g->confidence[i] = t.u;
        g->refusal[i] = 0.0;
    }
    g->singles = 0;
    g->ones = ones > 0;
    g->pairs = ones < GROUP;
    return !doubtful;
}

INLINE double least_answered(const Frame *restrict frame) {
    const Constants *k = frame->constants;
    const double of_power = k->least_power / k->per_variance1, of_modulus = k->least_modulus * k->least_modulus;
    return (1.0 + 1e-9) * at_least(at_least(of_power, of_modulus), 1e-200);
}

/* resolve.py: screened. On entry `refusal` holds SATURATED or 0. If the frame has a tail, few pixels need
 * fundamental_frame, so it runs later, and u is computed here. */
INLINE void screen(Group *restrict g, const Frame *restrict frame) {
    const Constants *k = frame->constants;
    if (frame->tail) EACH_PIXEL {
        double re1 = g->re1[i], im1 = g->im1[i], re2 = g->re2[i], im2 = g->im2[i], power1 = re1 * re1 + im1 * im1;
        g->u[i] = sqrt(power1);
        g->t1[i] = power1 * k->per_variance1 + (re2 * re2 + im2 * im2) * k->per_variance2;
    } else EACH_PIXEL g->t1[i] = power_of(g->u[i], g->pr[i], g->pi[i], k);
    if (frame->samples) EACH_PIXEL g->t1[i] = g->t1[i] * g->samples[i];
    EACH_PIXEL {
        double u = g->u[i], power = g->t1[i], refusal = g->refusal[i];
        int low = (power <= k->least_power) | (u < k->least_modulus), finite = power <= DBL_MAX;
        int unsound = (refusal > 0.0) | (g->unsound[i] > 0.0) | !finite;
        refusal = finite ? refusal : refusal + (double)NOT_FINITE;
        refusal = low & !unsound ? (double)LOW_CONFIDENCE : refusal;
        g->confidence[i] = unsound ? NAN : u;
        g->refusal[i] = refusal;
        g->answered[i] = unsound | low ? 0.0 : 1.0;
    }
}

/* solver.py: may_be_one_path; closed_form.py: is_single. A pixel without an answer gets u = NaN, so that all its later
 * values are NaN. */
INLINE void choose_pixels(Group *restrict g, const Frame *restrict frame) {
    const Constants *k = frame->constants;
    const double limit = one_path_limit(frame);
    int64_t pairs = 0;
    EACH_PIXEL g->t2[i] = limit;
    if (frame->samples && frame->order == ORDER_AUTO)
        EACH_PIXEL g->t2[i] = 2.0 * (k->misfit_limit / g->samples[i]) * k->misfit_spread;
    EACH_PIXEL {
        double answered = g->answered[i], single = is_single(g->u[i], g->d2[i]) ? answered : 0.0;
        double may = g->d2[i] <= g->t2[i] ? answered : single;
        g->u[i] = answered > 0.0 ? g->u[i] : NAN;
        g->single[i] = single;
        g->may[i] = may;
        pairs |= answered > may;
    }
    g->singles = any(g->single);
    g->ones = any(g->may);
    g->pairs = pairs != 0;
}

/* one_path.py: _start. The result is the rotor in t1, t2 and the largest possible curvature in t3. */
INLINE void one_path_start(Group *restrict g, double weight) {
    const double from_second = 4.0 * weight;
    EACH_PIXEL {
        double pr = g->pr[i], pi = g->pi[i], square = pr * pr + pi * pi;
        g->t3[i] = square * inverse_root(square);
    }
    EACH_PIXEL {
        double u = g->u[i], pr = g->pr[i], pi = g->pi[i], modulus = g->t3[i], half = 0.5 * modulus;
        double square = half * (modulus + fabs(pr)), inverse = inverse_root(square);
        double large = square * inverse, small = half * fabs(pi) * inverse;
        g->t1[i] = u + from_second * (pr >= 0.0 ? large : small);
        g->t2[i] = copysign(from_second * (pr >= 0.0 ? small : large), pi);
        g->t3[i] = u + from_second * modulus;
    }
    EACH_PIXEL {
        double cos = g->t1[i], sin = g->t2[i], norm = inverse_root_or_none(cos * cos + sin * sin);
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
    const double weights = 1.0 + 4.0 * weight, from_second = 4.0 * weight * weight;
    one_path_start(g, weight);
    if (frame->order == ORDER_ONE)
        for (int step = 0; step < 6; step++) one_path_step(g, weight);
    EACH_PIXEL {
        double cos = g->t1[i], sin = g->t2[i], u = g->u[i], pr = g->pr[i], pi = g->pi[i];
        double cos2 = cos * cos - sin * sin, sin2 = 2.0 * cos * sin;
        double along1 = u * cos, across1 = -u * sin, along2 = pr * cos2 + pi * sin2, across2 = pi * cos2 - pr * sin2;
        g->one_amplitude[i] = at_least((along1 + weight * along2) * per_weights, 0.0);
        g->amplitudes[i] = along1 - along2;
        g->phases[i] = 2.0 * across1 - across2;
        g->t4[i] = cos * g->cos[i] - sin * g->sin[i];
        g->t5[i] = cos * g->sin[i] + sin * g->cos[i];
    }
    EACH_PIXEL g->one_phase[i] = phase_of(g->t4[i], g->t5[i]);
    EACH_PIXEL {
        double share = at_most(g->one_amplitude[i], 1.0), more1 = k->doubled1 * share, more2 = k->doubled2 * share;
        double t1 = k->dark1 - more1, t2 = k->dark2 - more2;
        double r1 = at_least(k->dark1 + more1 - k->averaging1 * share * share, k->least1);
        double r2 = at_least(k->dark2 + more2 - k->averaging2 * share * share, k->least2);
        g->t1[i] = r1 + r2;
        g->t2[i] = 4.0 * t1 + t2;
        g->t4[i] = t1 + from_second * t2;
    }
    EACH_PIXEL {
        double along = g->t1[i], across = g->t2[i], amplitudes = g->amplitudes[i], phases = g->phases[i];
        double per_both = 1.0 / (along * across);
        g->t3[i] = (amplitudes * amplitudes * across + phases * phases * along) * per_both;
        g->fall_off[i] = amplitudes * fabs(amplitudes) * across * per_both * (1.0 / (1.2815515655446004 * 1.2815515655446004));
    }
    EACH_PIXEL {
        double weighted = g->one_amplitude[i] * weights, square = g->t4[i] * (weighted * weighted);
        g->one_sigma[i] = square < DBL_MIN ? INFINITY : g->t4[i] * inverse_root(square);
    }
    if (frame->samples) EACH_PIXEL {
        g->t3[i] = g->t3[i] * g->samples[i];
        g->fall_off[i] = g->fall_off[i] * g->samples[i];
        g->one_sigma[i] = g->one_sigma[i] / g->root[i];
    }
    EACH_PIXEL g->misfit[i] = g->t3[i] > k->misfit_limit ? g->may[i] : 0.0;
    if (g->singles) EACH_PIXEL g->misfit[i] = g->single[i] > 0.0 ? 0.0 : g->misfit[i];
    g->pairs |= any(g->misfit);
}

/* closed_form.py: one step of _excess. H is in t3. */
INLINE void excess_step(Group *restrict g, const int ahead) {
    EACH_PIXEL {
        if (ahead) end_inverse(g, i);
        double u = g->u[i], linear = g->t2[i], h = g->t3[i];
        double value = ((h + 3.0 * u) * h + linear) * h - g->t1[i];
        double slope = (h + (u + u)) * (3.0 * h) + linear, half_curvature = 3.0 * (h + u);
        double bent = value * half_curvature, least = slope * slope - bent;
        g->t3[i] = h - value * least / (slope * (least - bent) + value * value);
    }
}

/* closed_form.py: _excess. The result H is in t3. The processor waits for three quotients, one after the other. If the
 * phasors of the next group are loaded already (`ahead`), it computes their 1/|p1| meanwhile. */
INLINE void excess(Group *restrict g, const int ahead) {
    EACH_PIXEL {
        if (ahead) begin_inverse(g, i);
        double u = g->u[i], dr = u - g->pr[i], d2 = g->d2[i], modulus = d2 * rough_inverse_root(d2);
        g->t1[i] = u * d2;
        g->t2[i] = 2.0 * (u * dr) - d2;
        g->t3[i] = (modulus + 2.17 * u) * d2 / ((4.06 * modulus + 2.06 * dr) * u + d2);
    }
    /* not a loop over the steps: compilers would turn the loops inside out */
    excess_step(g, ahead);
    excess_step(g, 0);
}

/* closed_form.py: two_paths */
INLINE void two_paths(Group *restrict g, const int ahead) {
    excess(g, ahead);
    EACH_PIXEL {
        double u = g->u[i], dr = u - g->pr[i], h = g->t3[i], p0 = u + h, product = (p0 + u) * h;
        double re = p0 * dr - u * h, double_square = product + fabs(re);
        g->t1[i] = p0;
        g->t2[i] = re;
        g->t3[i] = h + dr;
        g->t4[i] = double_square;
        g->t5[i] = 2.0 * product * double_square;
        g->a[i] = rough_inverse_root(g->t5[i]);
    }
    EACH_PIXEL {
        double pi = g->pi[i], re = g->t2[i], norm = nearer_inverse_root(g->t5[i], g->a[i]);
        double large = g->t4[i] * norm, small = g->t1[i] * pi * norm;
        double cos_m = re >= 0.0 ? large : small, sin_m = re >= 0.0 ? small : large;
        double cos_half = (g->t3[i] * cos_m + pi * sin_m) * g->u[i] * (norm * large);
        g->cos_m[i] = cos_m;
        g->sin_m[i] = sin_m;
        g->cos_half[i] = cos_half;
        g->t2[i] = at_least((1.0 - cos_half) * (1.0 + cos_half), 1e-300);
    }
    EACH_PIXEL {
        double u = g->u[i], p0 = g->t1[i], cos = g->cos[i], sin = g->sin[i], cos_m = g->cos_m[i], sin_m = g->sin_m[i];
        double inverse = inverse_root(g->t2[i]), split = at_least(at_most(sin_m * u * inverse, p0), -p0);
        g->a[i] = 0.5 * (p0 + split);
        g->b[i] = 0.5 * (p0 - split);
        g->cos_m[i] = cos_m * cos + sin_m * sin;
        g->sin_m[i] = cos_m * sin - sin_m * cos;
        g->sin_half[i] = g->t2[i] * inverse;
    }
    if (g->singles) EACH_PIXEL {
        int single = g->single[i] > 0.0;
        g->a[i] = single ? g->u[i] : g->a[i];
        g->b[i] = single ? 0.0 : g->b[i];
        g->cos_m[i] = single ? g->cos[i] : g->cos_m[i];
        g->sin_m[i] = single ? g->sin[i] : g->sin_m[i];
        g->cos_half[i] = single ? 1.0 : g->cos_half[i];
        g->sin_half[i] = single ? 0.0 : g->sin_half[i];
    }
}

/* closed_form.py: TwoPaths.phases, of one pixel */
INLINE void put_phases(Group *restrict g, int i) {
    double mean = phase_of(g->cos_m[i], g->sin_m[i]), half = phase_above(g->cos_half[i], g->sin_half[i]);
    double x = mean + half, y = mean - half;
    y = y < 0.0 ? y + FULL_TURN : y;
    g->x[i] = x >= FULL_TURN ? x - FULL_TURN : x;
    g->y[i] = y >= FULL_TURN ? 0.0 : y;
}

INLINE void phases(Group *restrict g) { EACH_PIXEL put_phases(g, i); }

/* uncertainty.py: two_path_sigmas, in single precision too */
typedef struct {
    float cos, alone, own, other, signal, scale, share;
} VarianceTerms;

INLINE double sigma(float strength, float rival, VarianceTerms t) {
    float possible = strength * t.share, other_possible = rival * t.share;
    float excess = other_possible - possible * (1.0f + t.cos);
    float variance = possible * t.own + other_possible * t.other + t.alone - excess * excess * t.signal;
    variance = variance < 0.0f ? 0.0f : variance;
    return (double)(sqrtf(variance) / (strength * t.scale));
}

/* The phases are computed in the same loop, because the processor works on them while it waits for roots and quotients. */
INLINE void phases_and_sigmas(Group *restrict g, const Frame *restrict frame) {
    const Constants *k = frame->constants;
    const float alone0 = (float)k->alone0, alone1 = (float)k->alone1, alone2 = (float)k->alone2;
    const float own0 = (float)k->own0, own1 = (float)k->own1, own2 = (float)k->own2, own3 = (float)k->own3;
    const float own4 = (float)k->own4, signal = (float)k->signal;
    const float other0 = (float)k->other0, other1 = (float)k->other1, other2 = (float)k->other2;
    EACH_PIXEL {
        float gap = (float)(2.0 * g->sin_half[i] * g->sin_half[i]), a = (float)g->a[i], b = (float)g->b[i], c = 1.0f - gap;
        float total = a + b;
        VarianceTerms t = {
            c,
            (alone2 * c + alone1) * c + alone0,
            (((own4 * c + own3) * c + own2) * c + own1) * c + own0,
            (other2 * c + other1) * c + other0,
            gap * (1.0f + c) * signal,
            gap * (2.0f + c),
            1.0f / (total > 1.0f ? total : 1.0f),
        };
        g->sigma_x[i] = sigma(a, b, t);
        g->sigma_y[i] = sigma(b, a, t);
        put_phases(g, i);
    }
    EACH_PIXEL {
        /* doubt is larger / (0.5 * sin_half); it is above 1 exactly if larger > most, in floating point too */
        double x = g->sigma_x[i], y = g->sigma_y[i], larger = x > y ? x : y, most = 0.5 * g->sin_half[i];
        g->doubtful[i] = (larger > most) & (x == x) ? (double)ILL_CONDITIONED : 0.0;
    }
    if (frame->samples) EACH_PIXEL {
        double x = g->sigma_x[i], y = g->sigma_y[i], most = x < y ? y : x;
        most = y == y ? most : y;
        g->doubtful[i] = most / (0.5 * g->sin_half[i]) / g->root[i] > 1.0 ? (double)ILL_CONDITIONED : 0.0;
        g->sigma_x[i] = g->sigma_x[i] / g->root[i];
        g->sigma_y[i] = g->sigma_y[i] / g->root[i];
    }
}
