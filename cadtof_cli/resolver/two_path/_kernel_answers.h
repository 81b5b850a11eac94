/* From the fits of one path and of two paths to the answer of a pixel, and the loop over all pixels of a frame; see
 * _kernel_frame.h. */
#include "_kernel_paths.h"

/* Status bits of a pixel with one path. It is in doubt if its harmonics fall off more than noise explains. */
INLINE double bits_of_one(double fall_off) { return fall_off > 1.0 ? (double)(ONE_PATH + ILL_CONDITIONED) : (double)ONE_PATH; }

/* returns.py: _pair; order.py: worth_another, _fewer_where_enough; resolve.py: _bits. If `ones` is 0, no pixel of the
 * group may have one path. If `first` is 1, every pixel gets two paths, and the first return is asked for. */
INLINE void choose_answers(Group *restrict g, const Frame *restrict frame, const int ones, const int first) {
    const int strongest = !first && frame->returns == RETURN_STRONGEST, last = !first && frame->returns == RETURN_LAST;
    const double ratio = strongest ? 1.0 : frame->constants->return_ratio;
    EACH_PIXEL {
        double a = g->a[i], b = g->b[i], x = g->x[i], y = g->y[i], sigma_x = g->sigma_x[i], sigma_y = g->sigma_y[i], lead = y - x;
        int x_wraps = (lead > 0.5 * FULL_TURN) & (a < 0.5 * b), y_wraps = (lead < -0.5 * FULL_TURN) & (b < 0.5 * a);
        int wanted = (((lead >= 0.0) & !x_wraps) | y_wraps) ^ last, chosen = (a >= ratio * b) & (wanted | strongest);
        chosen = chosen | !(b >= ratio * a);
        double amplitude = chosen ? a : b, phase = chosen ? x : y, deviation = chosen ? sigma_x : sigma_y;
        double amplitude2 = chosen ? b : a, phase2 = chosen ? y : x, deviation2 = chosen ? sigma_y : sigma_x;
        phase2 = (chosen & y_wraps) | (x_wraps & !chosen) ? phase2 + FULL_TURN : phase2;
        double bits = 0.0;
        if (ones) {
            double difference = fabs(phase - g->one_phase[i]), one = g->one_sigma[i];
            difference = at_most(difference, FULL_TURN - difference);
            int worth = difference * difference > 2.0 * (deviation * deviation - one * one);
            int alone = (g->may[i] > 0.0) & !((g->misfit[i] > 0.0) & worth);
            amplitude = alone ? g->one_amplitude[i] : amplitude;
            phase = alone ? g->one_phase[i] : phase;
            deviation = alone ? one : deviation;
            amplitude2 = alone ? NAN : amplitude2;
            phase2 = alone ? NAN : phase2;
            deviation2 = alone ? NAN : deviation2;
            double one_path = bits_of_one(g->fall_off[i]);
            bits = fabs(amplitude) <= DBL_MAX ? one_path : 0.0;
        }
        bits = first || fabs(amplitude2) <= DBL_MAX ? (double)TWO_PATHS + g->doubtful[i] : bits;
        g->amplitude[0][i] = amplitude;
        g->amplitude[1][i] = amplitude2;
        g->phase[0][i] = phase;
        g->phase[1][i] = phase2;
        g->sigma[0][i] = deviation;
        g->sigma[1][i] = deviation2;
        g->refusal[i] = first ? bits : g->refusal[i] + bits;
    }
}

/* |d|^2 above which one path certainly leaves a misfit beyond the threshold, if |d| <= |p1|/8; see is_rivalled. */
INLINE double certain_misfit(const Frame *restrict frame) {
    const Constants *k = frame->constants;
    const double more1 = fabs(k->doubled1), more2 = fabs(k->doubled2), most = 4.0 * (k->dark1 + more1) + k->dark2 + more2;
    const double across = k->doubled1 >= 0.0 && k->doubled2 >= 0.0 ? 4.0 * k->dark1 + k->dark2 : most;
    const double variance = at_least(across, k->dark1 + more1 + k->dark2 + more2);
    return k->dark1 > more1 && k->dark2 > more2 ? 1.2 * k->misfit_limit * variance : INFINITY;
}

/* Return 1 if one path may replace the two paths in any pixel of a group. In a pixel, order.py certainly keeps two
 * paths if one path leaves too much misfit and both of the two paths lie farther from the one path than they scatter;
 * both can be told without the fit.
 *
 * Let |p1| = u and arg p1 = 0, p2 = pr + i pi with phase f, and |d| = |u - p2| <= u/8, so that |f| < 0.144.
 * one_path.py: _start takes a phase t between 0 and f/2. Its misfits along and across, A and P, differ from the parts
 * of d exp(-2it) by at most 0.07 |d|, so chi^2 >= 0.86 |d|^2 over the larger variance. And tan t is within 0.01 of
 * side/top, where side = 2w pi and top = u + 4w pr. So a path at x is farther from it than sqrt(2) sigma if
 * |sin x - cos x side/top| - 0.012 |side/top| > 1.43 sigma. */
INLINE int is_rivalled(const Group *restrict g, const Frame *restrict frame, double certain) {
    const double weight = frame->constants->weight;
    int64_t found = 0;
    EACH_PIXEL {
        double u = g->u[i], cos = g->cos[i], sin = g->sin[i], top = u + 4.0 * weight * g->pr[i], side = 2.0 * weight * g->pi[i];
        double re = top * cos - side * sin, im = top * sin + side * cos, cos_m = g->cos_m[i], sin_m = g->sin_m[i];
        double even = (sin_m * re - cos_m * im) * g->cos_half[i], odd = (cos_m * re + sin_m * im) * g->sin_half[i];
        double doubt = 0.012 * fabs(side), scatter = 1.43 * top, d2 = g->d2[i];
        int far = (fabs(even + odd) - doubt > scatter * g->sigma_x[i]) & (fabs(even - odd) - doubt > scatter * g->sigma_y[i]);
        found |= (g->may[i] > 0.0) & !(far & (d2 > certain) & (64.0 * d2 <= u * u));
    }
    return found != 0;
}

/* choose_answers if no pixel of a group needs two paths: pixels with an answer have one path, ... */
INLINE void answer_one(Group *restrict g) {
    EACH_PIXEL {
        double amplitude = g->one_amplitude[i];
        g->amplitude[0][i] = amplitude;
        g->phase[0][i] = g->one_phase[i];
        g->sigma[0][i] = g->one_sigma[i];
        g->amplitude[1][i] = NAN;
        double bits = bits_of_one(g->fall_off[i]);
        g->refusal[i] = g->refusal[i] + (fabs(amplitude) <= DBL_MAX ? bits : 0.0);
    }
}

/* ... and if no pixel of a group has an answer. */
INLINE void answer_none(Group *restrict g) {
    EACH_PIXEL g->amplitude[0][i] = g->phase[0][i] = g->sigma[0][i] = g->amplitude[1][i] = NAN;
}

/* Return 1 if a pixel has no answer and no bit says why. A pixel whose confidence is NaN has such a bit already. */
INLINE int is_unexplained(double amplitude, double confidence, double bits) {
    return (amplitude != amplitude) & (confidence == confidence) & (bits <= 0.0);
}

/* depth.py: clear_impossible. It compares the values as they are written, in float. A quick test in double comes first,
 * because few groups hold a pixel that may be impossible. A pixel without an answer does not pass it either, because
 * NaN is not below any limit. If all pixels have two paths, t1 still holds p0 of two_paths: the sum of the amplitudes,
 * which is not less than the confidence. */
INLINE void clear_impossible(Group *restrict g, const Frame *restrict frame, const int all_pairs) {
    const Constants *k = frame->constants;
    const double volts = k->volts, nearly = k->most_volts / volts * (1.0 - 1e-6);
    int64_t beyond = 0;
    if (all_pairs) EACH_PIXEL beyond |= !(g->t1[i] <= nearly);
    else EACH_PIXEL {
        double a = g->amplitude[0][i], b = g->amplitude[1][i], total = at_least(a, 0.0) + (b > 0.0 ? b : 0.0);
        beyond |= !((total <= nearly) & (g->confidence[i] <= nearly));
    }
    g->cleared = 0;
    if (!beyond) return;
    EACH_PIXEL g->t1[i] = k->most_volts;
    if (frame->samples) EACH_PIXEL g->t1[i] = k->most_volts + k->noise_volts / g->root[i];
    EACH_PIXEL {
        float a = (float)(g->amplitude[0][i] * volts), b = (float)(g->amplitude[1][i] * volts);
        float confidence = (float)(g->confidence[i] * volts), total = (a > 0.0f ? a : 0.0f) + (b > 0.0f ? b : 0.0f);
        const int unexplained = is_unexplained(g->amplitude[0][i], g->confidence[i], g->refusal[i]);
        double most = g->t1[i], clear = ((double)total > most) | ((double)confidence > most) | unexplained ? 1.0 : 0.0;
        g->impossible[i] = clear;
        for (int path = 0; path < 2; path++) {
            g->amplitude[path][i] = clear > 0.0 ? NAN : g->amplitude[path][i];
            g->phase[path][i] = clear > 0.0 ? NAN : g->phase[path][i];
            g->sigma[path][i] = clear > 0.0 ? NAN : g->sigma[path][i];
        }
        g->confidence[i] = clear > 0.0 ? NAN : g->confidence[i];
    }
    g->cleared = any(g->impossible);
}

/* diffuse/pixels.py: diffuse_pixels, for the pixels that can have an answer. Pixels that get their answer there leave
 * `answered`, because they need no other one. */
INLINE void predict(Group *restrict g, const Frame *restrict frame, int64_t start, int m) {
    TailGroup *restrict t = &g->tail;
    EACH_PIXEL {
        t->re[0][i] = g->re1[i];
        t->im[0][i] = g->im1[i];
        t->re[1][i] = g->re2[i];
        t->im[1][i] = g->im2[i];
        t->samples[i] = g->samples[i];
        t->answered[i] = g->answered[i];
    }
    answer_group(t, frame->tail, frame->tail->sizes->first + start, m, frame->samples != NULL);
    EACH_PIXEL {
        g->predicted[i] = t->answered[i];
        g->answered[i] = g->answered[i] - t->answered[i];
    }
}

/* resolve.py: _put_tail */
INLINE void put_tail(Group *restrict g, const Frame *restrict frame) {
    const TailGroup *restrict t = &g->tail;
    const double variance = frame->tail->constants->separate_variance;
    if (!g->pairs) EACH_PIXEL g->phase[1][i] = g->sigma[1][i] = NAN;
    g->pairs = 1;
    int64_t others = 0;
    EACH_PIXEL others |= !(g->predicted[i] > 0.0);
    for (int path = 0; path < 2; path++) {
        if (others) EACH_PIXEL g->sigma[path][i] = sqrt(g->sigma[path][i] * g->sigma[path][i] + variance);
        EACH_PIXEL {
            const double predicted = g->predicted[i];
            const float amplitude = path ? t->mpi[0][i] : t->direct[0][i], phase = path ? t->mpi[1][i] : t->direct[1][i];
            const float deviation = path ? t->mpi[2][i] : t->direct[2][i];
            g->amplitude[path][i] = predicted > 0.0 ? (double)amplitude : g->amplitude[path][i];
            g->phase[path][i] = predicted > 0.0 ? (double)phase : g->phase[path][i];
            g->sigma[path][i] = predicted > 0.0 ? (double)deviation : g->sigma[path][i];
        }
    }
    EACH_PIXEL g->refusal[i] = g->predicted[i] > 0.0 ? (double)DIFFUSE_MPI : g->refusal[i];
}

/* Resolve all pixels of a frame, group by group. */
INLINE void resolve_pixels(const Frame *restrict frame) {
    const int64_t stop = frame->pixels;
    Group group, *g = &group;
    const int plain = !frame->samples && !frame->own, one_scale = !frame->metres && !frame->shift;
    const double least = least_answered(frame), certain = certain_misfit(frame);
    int64_t ahead = -1; /* first pixel of the next group if its phasors are loaded already; -1: they are not */
    memset(g, 0, sizeof group);
    int m;
    for (int64_t start = 0; start < stop; start += m) {
        m = frame->tail ? in_row(frame->tail, start, stop) : in_group(stop - start);
        fetch(frame, start + 2 * GROUP);
        const int sound = m == GROUP && plain && is_sound(frame, start);
        int answered = sound && !frame->tail, loaded = 0;
        if (answered) {
            if (ahead != start) {
                load_sound(g, frame, start);
                EACH_PIXEL begin_inverse(g, i);
                EACH_PIXEL end_inverse(g, i);
            }
            answered = all_answered(g, frame, least);
        }
        if (!answered) {
            ahead = -1;
            loaded = !(sound && frame->tail);
            if (loaded) load(g, frame, start, m);
            else {
                load_sound(g, frame, start);
                EACH_PIXEL g->unsound[i] = g->refusal[i] = 0.0;
            }
            if (!frame->tail) fundamental_frame(g);
            screen(g, frame);
            if (frame->tail) predict(g, frame, start, m);
            if (frame->tail && any(g->answered)) fundamental_frame(g);
            choose_pixels(g, frame);
        }
        /* two paths first: if every pixel has an answer, most pixels with two paths need no fit of one path */
        const int pairs_first = answered && g->pairs;
        enum { ONES, PAIRS, DONE } next = pairs_first ? PAIRS : ONES;
        while (next != DONE) {
            if (next == ONES) {
                if (g->ones) one_path(g, frame);
                next = g->pairs && !pairs_first ? PAIRS : DONE;
            } else {
                ahead = answered && stop - start >= 2 * GROUP ? start + GROUP : -1;
                if (ahead >= 0) load_sound(g, frame, ahead);
                two_paths(g, 1);
                phases_and_sigmas(g, frame);
                if (pairs_first && g->ones) g->ones = is_rivalled(g, frame, certain);
                next = pairs_first ? ONES : DONE;
            }
        }
        if (g->pairs && g->ones) choose_answers(g, frame, 1, 0);
        else if (g->pairs && answered && frame->returns == RETURN_FIRST) choose_answers(g, frame, 0, 1);
        else if (g->pairs) choose_answers(g, frame, 0, 0);
        else if (g->ones) answer_one(g);
        else answer_none(g);
        if (frame->tail) put_tail(g, frame);
        if (answered && g->pairs && !g->ones) clear_impossible(g, frame, 1);
        else clear_impossible(g, frame, 0);
        if (answered && one_scale && !g->cleared) store(g, frame, start, GROUP, 1, 0);
        else store(g, frame, start, m, 0, loaded);
    }
}

/* A status map, and the number of its pixels with each of four bits. */
typedef struct {
    const uint32_t *status;
    int64_t pixels;
    int64_t *counts;
} Counted;

/* kernel.py: count_status */
INLINE void count_pixels(const Counted *restrict all) {
    const uint32_t *restrict status = all->status;
    enum { AT_ONCE = 4096 }; /* sums over so few pixels fit into 32 bits */
    for (int64_t start = 0; start < all->pixels; start += AT_ONCE) {
        const int64_t stop = all->pixels - start < AT_ONCE ? all->pixels : start + AT_ONCE;
        uint32_t one = 0, two = 0, more = 0, diffuse = 0;
        for (int64_t i = start; i < stop; i++) {
            one += (status[i] & ONE_PATH) / ONE_PATH;
            two += (status[i] & TWO_PATHS) / TWO_PATHS;
            more += (status[i] & MORE_PATHS) / MORE_PATHS;
            diffuse += (status[i] & DIFFUSE_MPI) / DIFFUSE_MPI;
        }
        all->counts[0] += one;
        all->counts[1] += two;
        all->counts[2] += more;
        all->counts[3] += diffuse;
    }
}

#define DECOMPOSED_PLANES 9

/* Two phasors of n pixels, re and im, and their two paths, in planes: both amplitudes, the rotors of mean and half, 1 if
 * there is one path, and both phases. */
typedef struct {
    const double *first, *second;
    double *paths;
    int64_t pixels;
} Decomposed;

/* decomposition.py: decomposed */
INLINE void decompose_pixels(const Decomposed *restrict all) {
    const double *restrict first = all->first, *restrict second = all->second;
    double *restrict to = all->paths;
    const int64_t n = all->pixels;
    Group group, *g = &group;
    for (int64_t start = 0; start < n; start += GROUP) {
        const int m = in_group(n - start);
        for (int i = 0; i < GROUP; i++) {
            const int64_t at = 2 * (start + (i < m ? i : 0));
            g->re1[i] = first[at];
            g->im1[i] = first[at + 1];
            g->re2[i] = second[at];
            g->im2[i] = second[at + 1];
        }
        fundamental_frame(g);
        EACH_PIXEL g->single[i] = is_single(g->u[i], g->d2[i]) ? 1.0 : 0.0;
        g->singles = any(g->single);
        two_paths(g, 0);
        phases(g);
        const double *plane[DECOMPOSED_PLANES] = {g->a, g->b, g->cos_m, g->sin_m, g->cos_half, g->sin_half, g->single, g->x, g->y};
        for (int p = 0; p < DECOMPOSED_PLANES; p++)
            for (int i = 0; i < m; i++) to[p * n + start + i] = plane[p][i];
    }
}
