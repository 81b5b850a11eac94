/* Logarithm, exponential, rotor and phase in single precision: the operations of elementary.py, in their order. */
#include "../two_path/_kernel_group.h"

#define FULL_TURN_F ((float)FULL_TURN)

INLINE float float_of(int32_t bits) {
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

INLINE int32_t bits_of(float value) {
    int32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return bits;
}

/* numpy.fmin(numpy.fmax(value, -most), most): NaN gives -most. */
INLINE float within_f(float value, float most) {
    value = value > -most ? value : -most;
    return value < most ? value : most;
}

/* elementary.py: _odd; z is the square of x, and `series` the value of the series at z. */
INLINE float odd(float series, float z, float x) { return series * z * x + x; }

INLINE float negated(float x, uint32_t sign) { return float_of((int32_t)((uint32_t)bits_of(x) ^ sign)); }

INLINE uint32_t sign_of(float x) { return (uint32_t)bits_of(x) & 0x80000000u; }

INLINE float logarithm(float x) {
    const int32_t bits = bits_of(x), power = (int32_t)((uint32_t)bits - 0x3f3504f3u) >> 23;
    const float mantissa = float_of((int32_t)((uint32_t)bits - ((uint32_t)power << 23)));
    const float s = (mantissa - 1.0f) / (mantissa + 1.0f), z = s * s, n = (float)power;
    float series = 0.147902f;
    series = series * z + 0.19994386f;
    series = series * z + 0.33333343f;
    const float half = odd(series, z, s);
    return n * 0.693359375f + (n * -0.00021219444f + (half + half));
}

INLINE float exponential(float x) {
    const float n = rintf(within_f(x, 80.0f) * 1.4426950408889634f), r = x - n * 0.693359375f - n * -0.00021219444f;
    float series = 0.0013926176f;
    series = series * r + 0.008363173f;
    series = series * r + 0.041666556f;
    series = series * r + 0.16666578f;
    series = series * r + 0.5f;
    const float mantissa = series * (r * r) + r + 1.0f;
    return mantissa * float_of((int32_t)((uint32_t)((int32_t)n + 127) << 23));
}

INLINE void rotor(float phase, float *cos, float *sin) {
    const float n = rintf(within_f(phase, 1e4f) * 0.3183098861837907f);
    const float r = phase - n * 3.140625f - n * 0.00096765359f, z = r * r;
    float sines = 2.6347564e-06f, cosines = -2.6546067e-07f;
    sines = sines * z + -0.0001982274f;
    sines = sines * z + 0.0083332425f;
    sines = sines * z + -0.16666666f;
    cosines = cosines * z + 2.4786083e-05f;
    cosines = cosines * z + -0.0013888812f;
    cosines = cosines * z + 0.041666668f;
    const uint32_t odd_turn = (uint32_t)(int32_t)n << 31;
    *cos = negated(cosines * (z * z) - 0.5f * z + 1.0f, odd_turn);
    *sin = negated(odd(sines, z, r), odd_turn);
}

INLINE float phase_of_f(float cos, float sin) {
    const float x = fabsf(cos), y = fabsf(sin);
    const float tangent = (y - x) / at_least_f(x + y, FLT_MIN), z = tangent * tangent;
    float series = 0.0038677573f;
    series = series * z + -0.020027727f;
    series = series * z + 0.04891432f;
    series = series * z + -0.08009682f;
    series = series * z + 0.108657576f;
    series = series * z + -0.14257045f;
    series = series * z + 0.19998683f;
    series = series * z + -0.3333333f;
    const float from_diagonal = 0.7853981633974483f - odd(series, z, tangent);
    return negated(1.5707963267948966f - negated(from_diagonal, sign_of(cos)), sign_of(sin));
}

/* tail.py: wrapped */
INLINE float wrapped(float phase) { return phase - FULL_TURN_F * rintf(phase / FULL_TURN_F); }

/* elementary.py: within_a_turn */
INLINE float within_a_turn(float phase) {
    const float inside = phase + (phase < 0.0f ? FULL_TURN_F : 0.0f);
    return inside - (inside >= FULL_TURN_F ? FULL_TURN_F : 0.0f);
}
