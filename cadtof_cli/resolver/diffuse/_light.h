/* The first look at a frame, sample by sample of its patches: from stored values to light. The operations are those of
 * phasors/voltages.py, of `screened` in resolver/resolve.py and of diffuse/light.py, in their order.
 */
typedef struct {
    const void *stored;              /* two planes per harmonic, of `type` */
    const double *own, *other, *constant; /* map to phasors: planes, or one number each, see `own_pixels`; NULL: zeros */
    const uint8_t *hot;              /* NULL: no pixel is hot */
    const double *samples;           /* number of recorded pixels that each pixel is a mean of; NULL: 1 */
    const int64_t *place, *number;   /* index of each sample in the frame, -1 outside; number of each harmonic */
    const double *per_variance;      /* 1 / dark variance of each harmonic */
    double saturated_low, saturated_high, least_power;
    float *weighted, *phase_rad;     /* 1 + 2 x harmonics planes of samples; one plane */
    uint8_t *seen;
    int64_t harmonics, pixels, count;
    enum type type;
    int own_pixels;                  /* 1: the map has planes of pixels */
} Sampled;

/* A plane of the map at the samples whose indices are `at`. If `at` is NULL, the map is the same for all pixels. */
INLINE void map_at(double *restrict row, const double *restrict plane, const int64_t *restrict at) {
    if (at) EACH_PIXEL row[i] = plane[at[i]];
    else EACH_PIXEL row[i] = plane[0];
}

#define GATHER(TYPE) { const TYPE *stored = (const TYPE *)all->stored + c * all->pixels; EACH_PIXEL value[c][i] = (double)stored[at[i]]; }

INLINE void look_at_group(const Sampled *restrict all, int64_t start, int m, int harmonics) {
    Row value[2 * MOST_HARMONICS], power, seen;
    FloatRow re[MOST_HARMONICS], im[MOST_HARMONICS], back_re, back_im, turned_re, turned_im, magnitude;
    int64_t at[GROUP];
    for (int i = 0; i < GROUP; i++) at[i] = all->place[start + (i < m ? i : 0)];
    EACH_PIXEL seen[i] = at[i] < 0 ? 0.0 : 1.0;
    EACH_PIXEL at[i] = at[i] < 0 ? 0 : at[i];
    if (all->hot) EACH_PIXEL seen[i] = all->hot[at[i]] ? 0.0 : seen[i];
    for (int c = 0; c < 2 * harmonics; c++) switch (all->type) {
        case TYPE_UINT16: GATHER(uint16_t) break;
        case TYPE_INT16: GATHER(int16_t) break;
        case TYPE_FLOAT32: GATHER(float) break;
        default: GATHER(double) break;
        }
    EACH_PIXEL {
        double least = INFINITY, most = -INFINITY;
        for (int c = 0; c < 2 * harmonics; c++) {
            least = value[c][i] < least ? value[c][i] : least;
            most = value[c][i] > most ? value[c][i] : most;
        }
        seen[i] = (least <= all->saturated_low) | (most >= all->saturated_high) ? 0.0 : seen[i];
    }
    for (int h = 0; h < harmonics; h++) {
        Row part[2], map;
        for (int k = 0; k < 2; k++) {
            const int64_t plane = (2 * h + k) * (all->own_pixels ? all->pixels : 1);
            const int64_t *places = all->own_pixels ? at : NULL;
            map_at(map, all->own + plane, places);
            EACH_PIXEL part[k][i] = value[2 * h + k][i] * map[i];
            if (all->other) {
                map_at(map, all->other + plane, places);
                EACH_PIXEL part[k][i] += value[2 * h + 1 - k][i] * map[i];
            }
            if (all->constant) {
                map_at(map, all->constant + plane, places);
                EACH_PIXEL part[k][i] += map[i];
            }
        }
        const double per_variance = all->per_variance[h];
        EACH_PIXEL {
            const double square = part[0][i] * part[0][i] + part[1][i] * part[1][i];
            power[i] = h ? power[i] + square * per_variance : square * per_variance;
            re[h][i] = (float)part[0][i];
            im[h][i] = (float)part[1][i];
            seen[i] = fabsf(re[h][i]) < LARGEST_AMPLITUDE && fabsf(im[h][i]) < LARGEST_AMPLITUDE ? seen[i] : 0.0;
        }
    }
    if (all->samples) EACH_PIXEL power[i] = power[i] * all->samples[at[i]];
    EACH_PIXEL {
        const int low = (power[i] <= all->least_power) | !(power[i] < INFINITY);
        const int dark = (re[0][i] == 0.0f) & (im[0][i] == 0.0f);
        seen[i] = low | dark ? 0.0 : seen[i];
    }
    for (int h = 0; h < harmonics; h++) EACH_PIXEL {
        re[h][i] = seen[i] > 0.0 ? re[h][i] : 0.0f;
        im[h][i] = seen[i] > 0.0 ? im[h][i] : 0.0f;
    }
    float *restrict to = all->weighted + start;
    FloatRow weighted[3];
    EACH_PIXEL {
        const float square = re[0][i] * re[0][i] + im[0][i] * im[0][i];
        magnitude[i] = sqrtf(square);
        const float inverse = 1.0f / at_least_f(magnitude[i], 1e-30f);
        back_re[i] = re[0][i] * inverse;
        back_im[i] = -im[0][i] * inverse;
        turned_re[i] = re[0][i];
        turned_im[i] = -im[0][i];
        weighted[0][i] = square;
        weighted[1][i] = re[0][i] * magnitude[i];
        weighted[2][i] = im[0][i] * magnitude[i];
    }
    for (int k = 0; k < 3; k++) for (int i = 0; i < m; i++) to[k * all->count + i] = weighted[k][i];
    int64_t power_of = 1;
    for (int h = 1; h < harmonics; h++) {
        for (; power_of < all->number[h]; power_of++) EACH_PIXEL {
            const float turned = turned_re[i] * back_re[i] - turned_im[i] * back_im[i];
            turned_im[i] = turned_re[i] * back_im[i] + turned_im[i] * back_re[i];
            turned_re[i] = turned;
        }
        EACH_PIXEL {
            weighted[0][i] = re[h][i] * turned_re[i] - im[h][i] * turned_im[i];
            weighted[1][i] = re[h][i] * turned_im[i] + im[h][i] * turned_re[i];
        }
        for (int k = 0; k < 2; k++) for (int i = 0; i < m; i++) to[(2 * h + 1 + k) * all->count + i] = weighted[k][i];
    }
    EACH_PIXEL weighted[0][i] = phase_of_f(re[0][i], im[0][i]);
    for (int i = 0; i < m; i++) {
        all->phase_rad[start + i] = weighted[0][i];
        all->seen[start + i] = seen[i] > 0.0;
    }
}

INLINE void look_at_samples(const Sampled *restrict all) {
    for (int64_t start = 0; start < all->count; start += GROUP) {
        const int m = in_group(all->count - start);
        /* the same call twice: if the number of harmonics is a constant, compilers unroll the loops */
        if (all->harmonics == 2) look_at_group(all, start, m, 2);
        else look_at_group(all, start, m, (int)all->harmonics);
    }
}

/* light.py: patch_means. Sums over the samples of every patch that count; the last plane is the number of these samples. */
typedef struct {
    const float *weighted;   /* planes x samples x patches */
    const uint8_t *counted;  /* samples x patches */
    double *sums;            /* planes + 1 x patches */
    int64_t planes, samples, patches;
} Sums;

#define MOST_SUMS (1 + 2 * MOST_HARMONICS)

INLINE void sum_group(const Sums *restrict all, int64_t start, int m, int planes) {
    Row sum[MOST_SUMS + 1];
    memset(sum, 0, sizeof sum);
    for (int64_t s = 0; s < all->samples; s++) {
        const uint8_t *restrict counted = all->counted + s * all->patches + start;
        FloatRow share, weighted;
        for (int i = 0; i < GROUP; i++) share[i] = counted[i < m ? i : 0] ? 1.0f : 0.0f;
        for (int k = 0; k < planes; k++) {
            const float *restrict from = all->weighted + (k * all->samples + s) * all->patches + start;
            FROM(weighted, from);
            EACH_PIXEL sum[k][i] += (double)(weighted[i] * share[i]);
        }
        EACH_PIXEL sum[planes][i] += (double)share[i];
    }
    for (int k = 0; k <= planes; k++)
        for (int i = 0; i < m; i++) all->sums[k * all->patches + start + i] = sum[k][i];
}

INLINE void sum_patches(const Sums *restrict all) {
    for (int64_t start = 0; start < all->patches; start += GROUP) {
        const int m = in_group(all->patches - start);
        /* the same call twice: if the number of planes is a constant, compilers unroll the loops */
        if (all->planes == 5) sum_group(all, start, m, 5);
        else sum_group(all, start, m, (int)all->planes);
    }
}
