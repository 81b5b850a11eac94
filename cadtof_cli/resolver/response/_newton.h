/* The search for two paths under any response: the operations of newton.py, in their order.
 *
 * Pixels need different numbers of steps. So when the pixel of a column is done, the column takes the next pixel at
 * once; no column waits for another.
 */
#include "../two_path/_kernel_group.h"
#include "_table.h"

#define MOST_STEPS 1000
#define LARGEST_TURN 0.4f

/* Constants that all pixels share: number h of each harmonic, 2 pi / ENTRIES / h of each, ENTRIES / 2 pi, 1 / variance
 * of each. */
enum { NUMBER_1, NUMBER_2, BACK_1, BACK_2, PER_STEP, WEIGHT_1, WEIGHT_2, SEARCH_CONSTANTS };

typedef struct {
    const float *constants;
    const float *table[2];    /* for each harmonic: ENTRIES times re, im and their slopes */
    const float *phase_rad;   /* own phases of the pixels, 2 x pixels; NULL: none */
    const float *observed;    /* 4 x pixels: re, im of harmonic 1, then of 2 */
    const float *enough;      /* misfit at which a pixel is done */
    const float *start;       /* 4 x pixels: a, x, b, y */
    float *values, *misfit;   /* 4 x pixels, and pixels */
    uint8_t *done;
    int64_t pixels;
    int steps;
} Search;

/* The answers of one harmonic to the two paths, and the residual of its phasor. */
typedef struct {
    FloatRow re[2], im[2], slope_re[2], slope_im[2], left_re, left_im;
} Side;

/* One pixel per column; `pixel` is -1 in columns without a pixel. */
typedef struct {
    Side side[2];
    FloatRow observed[4], phase_rad[2], enough, trial[4], values[4], step[4], misfit, left, closer;
    int64_t pixel[GROUP];
    int count[GROUP];
} SearchGroup;

/* numpy.maximum, with NaN from either side */
INLINE float larger(float a, float b) { return a > b || a != a ? a : b; }

/* table.py: at */
INLINE void look_up(Side *restrict to, int path, const float *restrict theta, const float *restrict table, float per_step, float back) {
    FloatRow place;
    int32_t index[GROUP];
    EACH_PIXEL {
        const float all = theta[i] * per_step, nearest = rintf(all);
        place[i] = (all - nearest) * back;
        index[i] = entry_at(nearest);
    }
    float *restrict re = to->re[path], *restrict im = to->im[path];
    float *restrict slope_re = to->slope_re[path], *restrict slope_im = to->slope_im[path];
    for (int i = 0; i < GROUP; i++) {
        const float *entry = table + 4 * index[i];
        re[i] = entry[0];
        im[i] = entry[1];
        slope_re[i] = entry[2];
        slope_im[i] = entry[3];
    }
    EACH_PIXEL {
        re[i] = re[i] + place[i] * slope_re[i];
        im[i] = im[i] + place[i] * slope_im[i];
    }
}

/* newton.py: fields */
INLINE void evaluate(SearchGroup *restrict g, const Search *restrict search, int row) {
    Side *restrict side = &g->side[row];
    const float number = search->constants[NUMBER_1 + row];
    for (int path = 0; path < 2; path++) {
        const float *restrict phase = g->trial[2 * path + 1];
        FloatRow theta;
        if (search->phase_rad) EACH_PIXEL theta[i] = phase[i] * number + g->phase_rad[row][i];
        else EACH_PIXEL theta[i] = phase[i] * number;
        look_up(side, path, theta, search->table[row], search->constants[PER_STEP], search->constants[BACK_1 + row]);
    }
    const float *restrict seen_re = g->observed[2 * row], *restrict seen_im = g->observed[2 * row + 1];
    const float *restrict a = g->trial[0], *restrict b = g->trial[2];
    EACH_PIXEL {
        side->left_re[i] = seen_re[i] - a[i] * side->re[0][i] - b[i] * side->re[1][i];
        side->left_im[i] = seen_im[i] - a[i] * side->im[0][i] - b[i] * side->im[1][i];
    }
}

/* newton.py: _minors, of one pixel */
typedef struct {
    float ab, ac, ad, bc, bd, cd, ra, rb, rc, rd;
} Minors;

INLINE Minors minors(const Side *restrict s, int i) {
    const float a = s->re[0][i], a_ = s->im[0][i], b = s->slope_re[0][i], b_ = s->slope_im[0][i];
    const float c = s->re[1][i], c_ = s->im[1][i], d = s->slope_re[1][i], d_ = s->slope_im[1][i];
    const float r = s->left_re[i], r_ = s->left_im[i];
    const Minors m = {a * b_ - a_ * b, a * c_ - a_ * c, a * d_ - a_ * d, b * c_ - b_ * c, b * d_ - b_ * d,
                      c * d_ - c_ * d, r * a_ - r_ * a, r * b_ - r_ * b, r * c_ - r_ * c, r * d_ - r_ * d};
    return m;
}

/* newton.py: newton_step, and in `search` the halving of a step that did not lower the misfit */
INLINE void take_step(SearchGroup *restrict g) {
    EACH_PIXEL {
        const Minors m = minors(&g->side[0], i), n = minors(&g->side[1], i);
        const float scale = 1.0f / (m.ab * n.cd - m.ac * n.bd + m.ad * n.bc + m.bc * n.ad - m.bd * n.ac + m.cd * n.ab);
        const float a = (m.rb * n.cd - m.rc * n.bd + m.rd * n.bc + m.bc * n.rd - m.bd * n.rc + m.cd * n.rb) * scale;
        const float x = (m.ad * n.rc + m.rc * n.ad - m.ra * n.cd - m.ac * n.rd - m.rd * n.ac - m.cd * n.ra) * scale / g->trial[0][i];
        const float b = (m.ab * n.rd + m.ra * n.bd - m.ad * n.rb - m.rb * n.ad + m.bd * n.ra + m.rd * n.ab) * scale;
        const float y = (m.ac * n.rb - m.ab * n.rc - m.ra * n.bc - m.bc * n.ra + m.rb * n.ac - m.rc * n.ab) * scale / g->trial[2][i];
        const float turn = LARGEST_TURN / larger(fabsf(x), fabsf(y)), share = 1.0f < turn ? 1.0f : turn;
        const float closer = g->closer[i];
        g->step[0][i] = closer > 0.0f ? a * share : 0.5f * g->step[0][i];
        g->step[1][i] = closer > 0.0f ? x * share : 0.5f * g->step[1][i];
        g->step[2][i] = closer > 0.0f ? b * share : 0.5f * g->step[2][i];
        g->step[3][i] = closer > 0.0f ? y * share : 0.5f * g->step[3][i];
    }
}

/* newton.py: one round of the loop in `search` */
INLINE void go_on(SearchGroup *restrict g, const Search *restrict search) {
    const float first = search->constants[WEIGHT_1], second = search->constants[WEIGHT_2];
    evaluate(g, search, 0);
    evaluate(g, search, 1);
    EACH_PIXEL {
        const Side *restrict s = &g->side[0], *restrict t = &g->side[1];
        const float left = first * (s->left_re[i] * s->left_re[i] + s->left_im[i] * s->left_im[i]) +
                           second * (t->left_re[i] * t->left_re[i] + t->left_im[i] * t->left_im[i]);
        g->closer[i] = left < g->misfit[i] ? 1.0f : 0.0f;
        g->misfit[i] = left < g->misfit[i] ? left : g->misfit[i];
        g->left[i] = left;
    }
    for (int v = 0; v < 4; v++) EACH_PIXEL g->values[v][i] = g->closer[i] > 0.0f ? g->trial[v][i] : g->values[v][i];
    take_step(g);
    /* stepped */
    for (int v = 0; v < 4; v++) EACH_PIXEL g->trial[v][i] = g->values[v][i] + g->step[v][i];
    for (int v = 0; v < 4; v += 2) EACH_PIXEL g->trial[v][i] = larger(g->trial[v][i], 0.1f * g->values[v][i]);
}

/* Load a pixel into a column. */
INLINE void begin(SearchGroup *restrict g, const Search *restrict search, int i, int64_t pixel) {
    g->pixel[i] = pixel;
    g->count[i] = 0;
    g->misfit[i] = INFINITY;
    g->enough[i] = search->enough[pixel];
    for (int v = 0; v < 4; v++) {
        g->observed[v][i] = search->observed[v * search->pixels + pixel];
        g->trial[v][i] = g->values[v][i] = search->start[v * search->pixels + pixel];
        g->step[v][i] = 0.0f;
    }
    if (search->phase_rad)
        for (int row = 0; row < 2; row++) g->phase_rad[row][i] = search->phase_rad[row * search->pixels + pixel];
}

/* Write the answer of a column. A pixel that is done takes one more step, which is not evaluated, unless the step is
 * not finite because the paths coincide. */
INLINE void end(const SearchGroup *restrict g, const Search *restrict search, int i, int done) {
    const int64_t pixel = g->pixel[i];
    int stepped = done;
    for (int v = 0; v < 4; v++) stepped = stepped && isfinite(g->trial[v][i]);
    for (int v = 0; v < 4; v++) search->values[v * search->pixels + pixel] = stepped ? g->trial[v][i] : g->values[v][i];
    search->misfit[pixel] = g->misfit[i];
    search->done[pixel] = (uint8_t)done;
}

INLINE void search_pixels(const Search *restrict search) {
    SearchGroup group, *g = &group;
    memset(g, 0, sizeof group);
    int64_t next = 0, going = 0;
    for (int i = 0; i < GROUP; i++) {
        g->pixel[i] = -1;
        if (next == search->pixels) continue;
        begin(g, search, i, next++);
        going++;
    }
    while (going) {
        go_on(g, search);
        for (int i = 0; i < GROUP; i++) {
            if (g->pixel[i] < 0) continue;
            const int done = g->left[i] <= g->enough[i];
            if (!done && g->count[i]++ < search->steps) continue;
            end(g, search, i, done);
            g->pixel[i] = -1;
            if (next < search->pixels) begin(g, search, i, next++);
            else going--;
        }
    }
}
