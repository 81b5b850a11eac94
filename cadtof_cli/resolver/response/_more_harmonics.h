/* more_harmonics.py: ResponseFit.linearised, with the same operations in the same order. A part of
 * likelihood/_levenberg_marquardt.h, which defines lanes and rows. */
#include "../two_path/_arcsine.h"
#include "_table.h"

#define STEP (FULL_TURN / ENTRIES) /* phase between neighbouring entries of a table */

/* table.py: at; ResponseBlock.turned_back. What paths of amplitude 1 with phases `phase_rad` give in a row, and its
 * derivative by the phase. */
static KERNEL_INLINE inline void answer_of(const Search *search, const Lanes *lanes, int row, const float *phase_rad, Row *re, Row *im,
                                           Row *slope_re, Row *slope_im) {
    const float *table = search->tables + 4 * (int64_t)ENTRIES * row;
    const float number = (float)search->harmonics[row], back = (float)(STEP / (double)search->harmonics[row]);
    for (int lane = 0; lane < LANES; lane++) {
        float theta = phase_rad[lane] * number;
        if (search->own_rad) theta += (float)((const double *)&lanes->own[0][row])[lane];
        const float place = theta * (float)(1.0 / STEP), nearest = rintf(place), beyond = (place - nearest) * back;
        const float *entry = table + 4 * entry_at(nearest);
        LANE(*re, lane) = (double)(entry[0] + beyond * entry[2]);
        LANE(*im, lane) = (double)(entry[1] + beyond * entry[3]);
        LANE(*slope_re, lane) = (double)entry[2];
        LANE(*slope_im, lane) = (double)entry[3];
    }
    if (!search->own_rad) return;
    const Row cos = lanes->own[1][row], sin = lanes->own[2][row];
    const Row turned = *re * cos + *im * sin, slope = *slope_re * cos + *slope_im * sin;
    *im = *im * cos - *re * sin;
    *slope_im = *slope_im * cos - *slope_re * sin;
    *re = turned;
    *slope_re = slope;
}

/* more_harmonics.py: ResponseFit.linearised. */
static KERNEL_INLINE inline void linearise_response(const Search *search, const Lanes *lanes, const Row *point, Linear *at, int k) {
    float phase_rad[MOST_PATHS][LANES];
    for (int i = 0; i < k; i++) {
        const double *cos = (const double *)&point[k + i], *sin = (const double *)&point[2 * k + i];
        for (int lane = 0; lane < LANES; lane++) phase_rad[i][lane] = (float)phase_of(cos[lane], sin[lane]);
    }
    for (int row = 0; row < search->rows; row++) {
        Row slope_re[MOST_STEPS], slope_im[MOST_STEPS];
        for (int i = 0; i < k; i++)
            answer_of(search, lanes, row, phase_rad[i], &slope_re[i], &slope_im[i], &slope_re[k + i], &slope_im[k + i]);
        Row re = point[0] * slope_re[0], im = point[0] * slope_im[0];
        for (int i = 1; i < k; i++) {
            re += point[i] * slope_re[i];
            im += point[i] * slope_im[i];
        }
        re = lanes->re[row] - re;
        im = lanes->im[row] - im;
        add_row(lanes, row, &re, &im, slope_re, slope_im, at, k);
    }
}
