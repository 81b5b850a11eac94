/* From one path and two to a pixel's answer, and all of it in its order; see _kernel_frame.h. */
#include "_kernel_paths.h"

/* Bits of one path, in doubt where its harmonics fall off by more than noise lets them. */
INLINE double bits_of_one(double fall_off) { return fall_off > 1.0 ? (double)(ONE_PATH + ILL_CONDITIONED) : (double)ONE_PATH; }

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
        double one = bits_of_one(g->fall_off[i]);
        double bits = fabs(g->amplitude[0][i]) <= DBL_MAX ? one : 0.0;
        bits = fabs(g->amplitude[1][i]) <= DBL_MAX ? (double)TWO_PATHS + g->doubtful[i] : bits;
        g->refusal[i] = g->refusal[i] + bits;
    }
}

/* The same where no pixel of a group needs two paths: who is answered has one. */
INLINE void decide_one(Group *restrict g) {
    EACH_PIXEL {
        double answered = g->answered[i], amplitude = answered > 0.0 ? g->one_amplitude[i] : NAN;
        g->amplitude[0][i] = amplitude;
        g->phase[0][i] = answered > 0.0 ? g->one_phase[i] : NAN;
        g->sigma[0][i] = answered > 0.0 ? g->one_sigma[i] : NAN;
        g->amplitude[1][i] = NAN;
        double one = bits_of_one(g->fall_off[i]);
        g->refusal[i] = g->refusal[i] + (fabs(amplitude) <= DBL_MAX ? one : 0.0);
    }
}

/* impossible.py: clear_impossible. What is compared is what is written, in float. */
INLINE void clear_impossible(Group *restrict g, const Frame *restrict frame) {
    const Constants *k = frame->constants;
    const double volts = k->volts;
    EACH_PIXEL g->t1[i] = k->most_volts;
    if (frame->samples) EACH_PIXEL g->t1[i] = k->most_volts + k->noise_volts / g->root[i];
    EACH_PIXEL {
        float a = (float)(g->amplitude[0][i] * volts), b = (float)(g->amplitude[1][i] * volts);
        float confidence = (float)(g->confidence[i] * volts), total = (a > 0.0f ? a : 0.0f) + (b > 0.0f ? b : 0.0f);
        double most = g->t1[i], beyond = (double)total > most ? 1.0 : 0.0;
        g->impossible[i] = (double)confidence > most ? 1.0 : beyond;
    }
    if (any(g->impossible)) EACH_PIXEL {
        double clear = g->impossible[i];
        for (int path = 0; path < 2; path++) {
            g->amplitude[path][i] = clear > 0.0 ? NAN : g->amplitude[path][i];
            g->phase[path][i] = clear > 0.0 ? NAN : g->phase[path][i];
            g->sigma[path][i] = clear > 0.0 ? NAN : g->sigma[path][i];
        }
        g->confidence[i] = clear > 0.0 ? NAN : g->confidence[i];
    }
}

/* resolve.py: diffuse_pixels, for the pixels that have an answer; those that get one there need no other. */
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
    for (int path = 0; path < 2; path++) {
        EACH_PIXEL {
            const double predicted = g->predicted[i], sigma = sqrt(g->sigma[path][i] * g->sigma[path][i] + variance);
            const float amplitude = path ? t->mpi[0][i] : t->direct[0][i], phase = path ? t->mpi[1][i] : t->direct[1][i];
            const float deviation = path ? t->mpi[2][i] : t->direct[2][i];
            g->amplitude[path][i] = predicted > 0.0 ? (double)amplitude : g->amplitude[path][i];
            g->phase[path][i] = predicted > 0.0 ? (double)phase : g->phase[path][i];
            g->sigma[path][i] = predicted > 0.0 ? (double)deviation : sigma;
        }
    }
    EACH_PIXEL g->refusal[i] = g->predicted[i] > 0.0 ? (double)DIFFUSE_MPI : g->refusal[i];
}

/* Every pixel from `start` up to `stop`. */
INLINE void resolve_pixels(const Frame *restrict frame, int64_t start, int64_t stop) {
    Group group, *g = &group;
    memset(g, 0, sizeof group);
    for (int m; start < stop; start += m) {
        m = frame->tail ? in_group(frame->tail, start, stop) : stop - start < GROUP ? (int)(stop - start) : GROUP;
        load(g, frame, start, m);
        if (!frame->tail) fundamental_frame(g);
        screen(g, frame);
        if (frame->tail) predict(g, frame, start, m);
        if (frame->tail && any(g->answered)) fundamental_frame(g);
        choose_pixels(g, frame);
        if (any(g->may)) one_path(g, frame);
        else EACH_PIXEL g->misfit[i] = 0.0;
        g->pairs = any(g->need);
        if (g->pairs) {
            two_paths(g);
            two_path_sigmas(g, frame);
            phases(g);
            direct_and_mpi(g, frame);
            decide(g);
        } else decide_one(g);
        if (frame->tail) put_tail(g, frame);
        clear_impossible(g, frame);
        store(g, frame, start, m);
    }
}
