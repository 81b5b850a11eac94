/* What radiosity.py works out for every pair of surfaces: the operations of _form_factors and _kernel, in their order. */
typedef struct {
    const float *facing, *area; /* onto x sources; of the sources */
    float *over, *square;       /* onto x sources: become form factors and phases */
    float rad_per_m;
    int64_t onto, sources;
} Pairs;

INLINE void form_factors_of(const Pairs *restrict all) {
    for (int64_t row = 0; row < all->onto; row++) {
        const float *restrict facing = all->facing + row * all->sources, *restrict area = all->area;
        float *restrict over = all->over + row * all->sources, *restrict square = all->square + row * all->sources;
        for (int64_t i = 0; i < all->sources; i++) {
            const float r2 = at_least_f(square[i], 1e-6f);
            const float lit = at_least_f(over[i], 0.0f) * at_least_f(facing[i], 0.0f) * area[i];
            over[i] = lit / ((r2 * 3.141592653589793f + area[i]) * r2);
            square[i] = sqrtf(r2) * all->rad_per_m;
        }
    }
}

typedef struct {
    const float *form, *albedo, *cos, *sin;  /* onto x sources, but albedo: of the sources */
    float *kernel, *turn;                    /* onto x sources, re and im */
    int64_t onto, sources;
} LightKernel;

INLINE void kernel_of(const LightKernel *restrict all) {
    for (int64_t row = 0; row < all->onto; row++) {
        const int64_t start = row * all->sources;
        const float *restrict form = all->form + start, *restrict albedo = all->albedo;
        const float *restrict cos = all->cos + start, *restrict sin = all->sin + start;
        float *restrict kernel = all->kernel + 2 * start, *restrict turn = all->turn + 2 * start;
        for (int64_t i = 0; i < all->sources; i++) {
            const float lit = form[i] * albedo[i];
            kernel[2 * i] = lit * cos[i];
            kernel[2 * i + 1] = lit * sin[i];
            turn[2 * i] = cos[i];
            turn[2 * i + 1] = sin[i];
        }
    }
}
