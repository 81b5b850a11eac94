/* Logarithm, exponential, rotor and phase in single precision: the operations of elementary.py, in their order. */
#include "../two_path/_kernel_group.h"

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

INLINE float logarithm(float x) {
    const int32_t bits = bits_of(x), power = (int32_t)((uint32_t)bits - 0x3f3504f3u) >> 23;
    const float mantissa = float_of((int32_t)((uint32_t)bits - ((uint32_t)power << 23)));
    const float s = (mantissa - 1.0f) / (mantissa + 1.0f), z = s * s, n = (float)power;
    float series = 0.147902f;
    series = series * z + 0.19994386f;
    series = series * z + 0.33333343f;
    const float half = s + s * z * series;
    return n * 0.693359375f + (n * -0.00021219444f + (half + half));
}

INLINE float exponential(float x) {
    const float n = rintf(within_f(x, 80.0f) * 1.4426950408889634f), r = x - n * 0.693359375f - n * -0.00021219444f;
    float series = 0.0013926176f;
    series = series * r + 0.008363173f;
    series = series * r + 0.041666556f;
    series = series * r + 0.16666578f;
    series = series * r + 0.5f;
    const float mantissa = r + r * r * series + 1.0f;
    return mantissa * float_of((int32_t)((uint32_t)((int32_t)n + 127) << 23));
}

INLINE void rotor(float phase, float *cos, float *sin) {
    const float n = rintf(within_f(phase, 1e4f) * 0.6366197723675814f);
    const float r = phase - n * 1.5703125f - n * 0.00048375130f - n * 7.5497900e-08f, z = r * r;
    float sines = -0.0001958789f, cosines = 2.4547942e-05f;
    sines = sines * z + 0.008332748f;
    sines = sines * z + -0.16666664f;
    cosines = cosines * z + -0.0013888302f;
    cosines = cosines * z + 0.041666664f;
    const float s = r + r * z * sines, c = z * z * cosines - 0.5f * z + 1.0f;
    const int32_t quadrant = (int32_t)n & 3;
    const float x = quadrant & 1 ? s : c, y = quadrant & 1 ? c : s;
    *cos = (quadrant + 1) & 2 ? -x : x;
    *sin = quadrant > 1 ? -y : y;
}

INLINE float phase_of_f(float cos, float sin) {
    const float x = fabsf(cos), y = fabsf(sin);
    const float tangent = (y > x ? x : y) / at_least_f(y > x ? y : x, FLT_MIN), z = tangent * tangent;
    float series = 0.0038667389f;
    series = series * z + -0.020026747f;
    series = series * z + 0.04891432f;
    series = series * z + -0.08009682f;
    series = series * z + 0.10865759f;
    series = series * z + -0.14257045f;
    series = series * z + 0.19998682f;
    series = series * z + -0.33333322f;
    float phase = tangent + tangent * z * series;
    phase = y > x ? 1.5707963267948966f - phase : phase;
    phase = cos < 0.0f ? 3.141592653589793f - phase : phase;
    return sin < 0.0f ? -phase : phase;
}

/* tail.py: wrapped */
INLINE float wrapped(float phase) { return phase - 6.283185307179586f * rintf(phase / 6.283185307179586f); }

/* elementary.py: within_a_turn */
INLINE float within_a_turn(float phase) {
    const float inside = phase + (phase < 0.0f ? 6.283185307179586f : 0.0f);
    return inside - (inside >= 6.283185307179586f ? 6.283185307179586f : 0.0f);
}
