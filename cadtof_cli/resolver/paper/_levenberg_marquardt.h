/* The search of Eq. (9), SHARE_LANES pixels at a time: the same operations in the same order as levenberg_marquardt.py,
 * equation_9.py and starts.py.
 *
 * A lane holds a pixel and one of its starts. When this search has ended, the next start of the pixel takes the lane.
 * If no start is left, or none can be better than the best end so far, the next pixel takes the lane. The loops over
 * the lanes are short and work on one row of numbers each, so that compilers vectorise them.
 */
enum { SHARE_LANES = 32 };

#define FURTHER_DAMPED 4.0
#define MORE_DAMPED 2.0
#define EASED 0.3
#define AS_PROMISED 0.9
#define LESS_THAN_PROMISED 0.25
#define HALF_SIDE 3.0
#define GOLDEN UINT64_C(0x9E3779B97F4A7C15)
#define ROW_SHIFT 40

/* The equations, and the arrays for the answers. Arrays consist of planes of `count` numbers. */
typedef struct {
    int rows, most_steps, first_start, last_start; /* rows: number of harmonics beyond the first */
    int64_t count;
    unsigned long long key; /* starts.py: RandomStarts.key */
    double relative, absolute, first_damping;
    const int64_t *harmonics, *places;
    const double *re, *im;
    double *z, *cost;
    uint8_t *converged;
    int64_t *steps;
} ShareSearch;

typedef double ShareRow[SHARE_LANES];

typedef struct {
    ShareRow cost, matrix[3], gradient[2];
} ShareLinear;

typedef struct {
    ShareRow re[MOST_ROWS], im[MOST_ROWS];
    ShareRow z_re, z_im, trial_re, trial_im, damping, added, promised, worth;
    ShareRow power[2][MOST_HARMONIC + 1][2], radius[2]; /* z and 1 − z: cosine and sine of j times the angle; modulus */
    ShareLinear now, there;
    ShareRow fresh, done, stopped, moves, ends, steps; /* flags: 1.0 or 0.0, because some processors lack vector compares
                                                          of 64-bit integers */
    /* index of the pixel, number of the start, steps so far, and the best end so far */
    int64_t pixel[SHARE_LANES], start[SHARE_LANES], taken[SHARE_LANES], converged[SHARE_LANES];
    ShareRow best_re, best_im, best_cost;
} Shares;

#define EACH_LANE for (int lane = 0; lane < SHARE_LANES; lane++)

static KERNEL_INLINE inline void share_move(const double *moves, double *here, const double *there) {
    EACH_LANE {
        const double stays = here[lane], comes = there[lane];
        here[lane] = moves[lane] != 0.0 ? comes : stays;
    }
}

/* levenberg_marquardt.py: MisfitDamped.step. In fresh lanes z does not change. */
static KERNEL_INLINE inline void share_step(const ShareSearch *search, Shares *at) {
    const ShareLinear *now = &at->now;
    const double relative = search->relative, absolute = search->absolute;
    EACH_LANE at->added[lane] = at->damping[lane] * sqrt(now->cost[lane]);
    EACH_LANE {
        const double cost = now->cost[lane], damping = at->added[lane];
        const double a = now->matrix[0][lane] + damping, b = now->matrix[1][lane], d = now->matrix[2][lane] + damping;
        const double product = a * d, least = LEAST_PIVOT * product + TINY, exact = product - b * b;
        const double scale = 1.0 / (exact < least ? least : exact); /* NaN stays NaN, as in numpy.maximum */
        const double first = now->gradient[0][lane], second = now->gradient[1][lane];
        const double x = (d * first - b * second) * scale, y = (a * second - b * first) * scale;
        const double promised = x * (first + damping * x) + y * (second + damping * y);
        at->promised[lane] = promised;
        at->worth[lane] = relative * cost + absolute;
        at->trial_re[lane] = at->z_re[lane] + x;
        at->trial_im[lane] = at->z_im[lane] + y;
    }
    share_move(at->fresh, at->trial_re, at->z_re);
    share_move(at->fresh, at->trial_im, at->z_im);
}

/* equation_9.py: rotors_of. */
static KERNEL_INLINE inline void share_rotors(const ShareSearch *search, Shares *at) {
    EACH_LANE {
        const double re = at->trial_re[lane], im = at->trial_im[lane], other = 1.0 - re;
        const double radius = sqrt(re * re + im * im), other_radius = sqrt(other * other + im * im);
        const double none = radius == 0.0 ? 1.0 : 0.0, other_none = other_radius == 0.0 ? 1.0 : 0.0;
        const double divisor = radius + none, other_divisor = other_radius + other_none;
        const double scale = 1.0 / (divisor * other_divisor);
        const double here = scale * other_divisor, there = scale * divisor;
        at->radius[0][lane] = radius;
        at->radius[1][lane] = other_radius;
        at->power[0][1][0][lane] = re * here + none;
        at->power[0][1][1][lane] = im * here;
        at->power[1][1][0][lane] = other * there + other_none;
        at->power[1][1][1][lane] = -im * there;
    }
    const int64_t most = largest(search->harmonics, search->rows);
    for (int path = 0; path < 2; path++)
        for (int64_t h = 2; h <= most; h++) { /* rotors.py: powers */
            ShareRow *a = at->power[path][h / 2], *b = at->power[path][h - h / 2], *to = at->power[path][h];
            EACH_LANE {
                const double re = a[0][lane] * b[0][lane] - a[1][lane] * b[1][lane];
                const double im = a[0][lane] * b[1][lane] + a[1][lane] * b[0][lane];
                to[0][lane] = re;
                to[1][lane] = im;
            }
        }
}

/* equation_9.py: EliminatedPath.linearised, at the trial points. */
static KERNEL_INLINE inline void share_linearise(const ShareSearch *search, Shares *at) {
    ShareLinear *to = &at->there;
    share_rotors(search, at);
    EACH_LANE to->cost[lane] = 0.0;
    for (int i = 0; i < 3; i++) EACH_LANE to->matrix[i][lane] = 0.0;
    for (int i = 0; i < 2; i++) EACH_LANE to->gradient[i][lane] = 0.0;
    for (int row = 0; row < search->rows; row++) {
        const int64_t number = search->harmonics[row];
        const double j = (double)number;
        ShareRow *one = at->power[0][1], *other = at->power[1][1], *z = at->power[0][number], *w = at->power[1][number];
        EACH_LANE {
            const double cos = one[0][lane], sin = one[1][lane], other_cos = other[0][lane], other_sin = other[1][lane];
            const double z_re = z[0][lane], z_im = z[1][lane], w_re = w[0][lane], w_im = w[1][lane];
            /* equation_9.py: _derivatives */
            const double re_x = (z_re * cos + j * z_im * sin) - (w_re * other_cos + j * w_im * other_sin);
            const double im_x = (z_im * cos - j * z_re * sin) - (w_im * other_cos - j * w_re * other_sin);
            const double re_y = (z_re * sin - j * z_im * cos) - (w_re * other_sin - j * w_im * other_cos);
            const double im_y = (z_im * sin + j * z_re * cos) - (w_im * other_sin + j * w_re * other_cos);
            const double re = at->re[row][lane] - at->radius[0][lane] * z_re - at->radius[1][lane] * w_re;
            const double im = at->im[row][lane] - at->radius[0][lane] * z_im - at->radius[1][lane] * w_im;
            to->cost[lane] += re * re + im * im;
            to->matrix[0][lane] += re_x * re_x + im_x * im_x;
            to->matrix[1][lane] += re_x * re_y + im_x * im_y;
            to->matrix[2][lane] += re_y * re_y + im_y * im_y;
            to->gradient[0][lane] += re_x * re + im_x * im;
            to->gradient[1][lane] += re_y * re + im_y * im;
        }
    }
}

/* likelihood/levenberg_marquardt.py: the second part of _stepped; levenberg_marquardt.py: next_damping. Sets which lanes have
 * stopped. */
static KERNEL_INLINE inline void share_judge(const ShareSearch *search, Shares *at) {
    ShareLinear *now = &at->now;
    const ShareLinear *there = &at->there;
    const double first_damping = search->first_damping, most_steps = (double)search->most_steps;
    EACH_LANE {
        const double fresh = at->fresh[lane], promised = at->promised[lane], damping = at->damping[lane];
        const double drop = now->cost[lane] - there->cost[lane], further = FURTHER_DAMPED * damping, steps = at->steps[lane];
        const double more = MORE_DAMPED * damping, eased = EASED * damping;
        double next = drop < LESS_THAN_PROMISED * promised ? more : damping;
        next = drop > AS_PROMISED * promised ? eased : next;
        next = drop > 0.0 ? next : further;
        const double done = promised <= at->worth[lane] ? 1.0 : 0.0;
        double stopped = done, ends;
        stopped = next < MOST_DAMPING ? stopped : 1.0;
        stopped = promised - promised == 0.0 ? stopped : 1.0;
        stopped = fresh != 0.0 ? 0.0 : stopped;
        at->done[lane] = done;
        at->stopped[lane] = stopped;
        at->damping[lane] = fresh != 0.0 ? first_damping : next;
        ends = steps + 1.0 - fresh < most_steps ? stopped : 1.0;
        at->steps[lane] = steps + 1.0 - fresh;
        at->ends[lane] = ends;
        at->moves[lane] = drop > 0.0 ? 1.0 : fresh;
        at->fresh[lane] = 0.0;
    }
    share_move(at->moves, at->z_re, at->trial_re);
    share_move(at->moves, at->z_im, at->trial_im);
    for (int i = 0; i < 3; i++) share_move(at->moves, now->matrix[i], there->matrix[i]);
    for (int i = 0; i < 2; i++) share_move(at->moves, now->gradient[i], there->gradient[i]);
    share_move(at->moves, now->cost, there->cost);
}

/* starts.py: RandomStarts.of. */
static inline void share_begin(const ShareSearch *search, Shares *at, int lane) {
    uint64_t bits = ((uint64_t)search->places[at->pixel[lane]] + ((uint64_t)at->start[lane] << ROW_SHIFT)) * GOLDEN + search->key;
    bits = (bits ^ (bits >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
    bits = (bits ^ (bits >> 27)) * UINT64_C(0x94D049BB133111EB);
    bits ^= bits >> 31;
    at->z_re[lane] = (double)(bits >> 32) * (2.0 * HALF_SIDE / 4294967296.0) + (0.5 - HALF_SIDE);
    at->z_im[lane] = (double)(bits & UINT64_C(0xFFFFFFFF)) * (2.0 * HALF_SIDE / 4294967296.0) - HALF_SIDE;
    at->fresh[lane] = 1.0;
    at->steps[lane] = 0.0;
}

static inline void share_load(const ShareSearch *search, Shares *at, int lane, int64_t pixel) {
    for (int row = 0; row < search->rows; row++) {
        at->re[row][lane] = search->re[row * search->count + pixel];
        at->im[row][lane] = search->im[row * search->count + pixel];
    }
    at->pixel[lane] = pixel;
    at->start[lane] = search->first_start;
    at->best_re[lane] = at->best_im[lane] = NAN;
    at->best_cost[lane] = INFINITY;
    at->converged[lane] = at->taken[lane] = 0;
    share_begin(search, at, lane);
}

/* Keep the end of a search if it is the best of its pixel. If the pixel needs no more starts, write its answer and
 * return 1; otherwise begin the next start and return 0. */
static inline int share_end(const ShareSearch *search, Shares *at, int lane) {
    if (at->now.cost[lane] < at->best_cost[lane]) {
        at->best_re[lane] = at->z_re[lane];
        at->best_im[lane] = at->z_im[lane];
        at->best_cost[lane] = at->now.cost[lane];
        at->converged[lane] = at->stopped[lane] != 0.0 && at->done[lane] != 0.0;
    }
    /* the step with which a search stops does not count */
    at->taken[lane] += (int64_t)(at->steps[lane] - at->stopped[lane]);
    at->start[lane]++;
    if (!(at->best_cost[lane] <= search->absolute) && at->start[lane] < search->last_start) {
        share_begin(search, at, lane);
        return 0;
    }
    const int64_t pixel = at->pixel[lane];
    search->z[pixel] = at->best_re[lane];
    search->z[search->count + pixel] = at->best_im[lane];
    search->cost[pixel] = at->best_cost[lane];
    search->converged[pixel] = at->converged[lane] != 0;
    search->steps[pixel] = at->taken[lane];
    return 1;
}

static KERNEL_INLINE inline void share_all(const ShareSearch *search) {
    Shares lanes, *at = &lanes;
    int64_t next = 0, held = 0, busy[SHARE_LANES] = {0};
    memset(at, 0, sizeof lanes);
    for (int lane = 0; lane < SHARE_LANES && next < search->count; lane++, held++) {
        busy[lane] = 1;
        share_load(search, at, lane, next++);
    }
    while (held) {
        share_step(search, at);
        share_linearise(search, at);
        share_judge(search, at);
        EACH_LANE {
            if (at->ends[lane] == 0.0 || !busy[lane] || !share_end(search, at, lane)) continue;
            busy[lane] = next < search->count;
            if (busy[lane]) share_load(search, at, lane, next++);
            else held--;
        }
    }
}
