#define NEAREST_M2 1e-6f /* radiosity.py */

/* What radiosity.py computes for every pair of surfaces: the operations of _light_matrix, in their order. */
typedef struct {
    const float *facing, *square, *area, *albedo; /* onto x sources; areas and albedos: one per source */
    float *over;                                  /* onto x sources: heights over planes, then form factors */
    float *matrix, *turn;                         /* onto x sources, re and im */
    float rad_per_m;
    int64_t onto, sources;
} Pairs;

/* m pairs of one row, from `start` on; `source` is the source of the first. */
INLINE void matrix_of_group(const Pairs *restrict all, int64_t start, int64_t source, int m) {
    FloatRow over, facing, area, r2, albedo, cos, sin;
    FROM(over, all->over + start);
    FROM(facing, all->facing + start);
    FROM(r2, all->square + start);
    FROM(area, all->area + source);
    FROM(albedo, all->albedo + source);
    EACH_PIXEL r2[i] = at_least_f(r2[i], NEAREST_M2);
    EACH_PIXEL over[i] = at_least_f(over[i], 0.0f) * at_least_f(facing[i], 0.0f) * area[i] / ((r2[i] * (float)PI + area[i]) * r2[i]);
    EACH_PIXEL rotor(sqrtf(r2[i]) * all->rad_per_m, &cos[i], &sin[i]);
    float *restrict matrix = all->matrix + 2 * start, *restrict turn = all->turn + 2 * start;
    for (int i = 0; i < m; i++) {
        const float sent = over[i] * albedo[i];
        all->over[start + i] = over[i];
        matrix[2 * i] = sent * cos[i];
        matrix[2 * i + 1] = sent * sin[i];
        turn[2 * i] = cos[i];
        turn[2 * i + 1] = sin[i];
    }
}

INLINE void matrix_of(const Pairs *restrict all) {
    for (int64_t row = 0; row < all->onto; row++)
        for (int64_t source = 0; source < all->sources; source += GROUP)
            matrix_of_group(all, row * all->sources + source, source, in_group(all->sources - source));
}
