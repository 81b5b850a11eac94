/* The scans over a coarse grid of delays, LANES pixels at a time: the same operations as in starts.py, in the same
 * order. */
enum { MOST_PLACES = 8 * MOST_HARMONIC };

/* Input and output of a scan. Arrays consist of planes of `count` numbers. */
typedef struct {
    int rows, places, pairs;
    int64_t count;
    const double *factors; /* weight·cos and weight·sin for each place and row */
    const double *lags;    /* ρ, −2ρ and 1/(1 − ρ²) for each lag from 1 on */
    const double *re, *im;
    int64_t *first, *lag; /* place of the best path; in the best pair, the other path lies `lag` places later */
    double *peak, *other; /* matched sums of the best path and of the other path */
} Scan;

/* Find the place of the largest sum, or of the first NaN. */
static KERNEL_INLINE inline void highest(const Row *matched, int places, Row *best) {
    Row most = matched[0];
    *best = ALL(0.0);
    for (int place = 1; place < places; place++) {
        const Mask better = BELOW(most, matched[place]) | (~SAME(matched[place], matched[place]) & SAME(most, most));
        most = SELECT(better, matched[place], most);
        *best = SELECT(better, ALL((double)place), *best);
    }
}

/* Find the best pair: the place of its first path times MOST_PLACES, plus the lag of the other path. Of equal pairs,
 * the first in the order of places wins. */
static KERNEL_INLINE inline void best_pair(const Row *matched, int places, const double *lags, Row *best) {
    Row most = ALL(-INFINITY);
    *best = ALL(1.0);
    for (int place = 0; place < places; place++) {
        const Row here = matched[place], square = here * here;
        for (int lag = 1; lag <= places / 2; lag++) {
            const double *of_lag = lags + 3 * (lag - 1);
            const Row there = matched[place + lag < places ? place + lag : place + lag - places];
            const Row explained = (here * there * of_lag[1] + square + there * there) * of_lag[2];
            const Mask better = BELOW(most, explained) & BELOW(of_lag[0] * there, here) & BELOW(of_lag[0] * here, there);
            most = SELECT(better, explained, most);
            *best = SELECT(better, ALL((double)(place * MOST_PLACES + lag)), *best);
        }
    }
}

static KERNEL_INLINE inline void scan_lanes(const Scan *scan, int64_t start, int held) {
    Row re[MOST_ROWS], im[MOST_ROWS], matched[MOST_PLACES], best;
    const int places = scan->places;
    for (int row = 0; row < scan->rows; row++)
        for (int lane = 0; lane < LANES; lane++) {
            const int64_t pixel = row * scan->count + start + (lane < held ? lane : 0);
            LANE(re[row], lane) = scan->re[pixel];
            LANE(im[row], lane) = scan->im[pixel];
        }
    for (int place = 0; place < places; place++) {
        const double *factor = scan->factors + 2 * place * scan->rows;
        Row total = ALL(0.0);
        for (int row = 0; row < scan->rows; row++) {
            total += factor[2 * row] * re[row];
            total += factor[2 * row + 1] * im[row];
        }
        matched[place] = total;
    }
    if (scan->pairs) best_pair(matched, places, scan->lags, &best);
    else highest(matched, places, &best);
    for (int lane = 0; lane < held; lane++) {
        const int found = (int)LANE(best, lane), first = scan->pairs ? found / MOST_PLACES : found;
        const int lag = scan->pairs ? found % MOST_PLACES : 1;
        scan->first[start + lane] = first;
        scan->lag[start + lane] = lag;
        scan->peak[start + lane] = LANE(matched[first], lane);
        scan->other[start + lane] = LANE(matched[(first + lag) % places], lane);
    }
}

static KERNEL_INLINE inline void scan_all(const Scan *scan) {
    for (int64_t start = 0; start < scan->count; start += LANES)
        scan_lanes(scan, start, scan->count - start < LANES ? (int)(scan->count - start) : LANES);
}
