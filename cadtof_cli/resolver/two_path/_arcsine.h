/* The phase of a rotor, with the operations of arcsine.py in their order, so that all bits are the same. */
#ifndef KERNEL_ARCSINE_H
#define KERNEL_ARCSINE_H
#include <math.h>

#define PI 3.141592653589793
#define FULL_TURN 6.283185307179586

/* arcsine.py: phase_of, for sines that are not negative */
static KERNEL_INLINE inline double phase_above(double cos, double y) {
    double x = fabs(cos);
    double low = y > x ? x : y, high = y > x ? y : x;
    int far = low > 0.25881904510252074;
    double sine = far ? low * 0.8660254037844386 - high * 0.5 : low;
    double z = sine * sine, series = 0.01456748213483585;
    series = series * z + 0.013621509253689112;
    series = series * z + 0.017372651805504305;
    series = series * z + 0.022371526870346412;
    series = series * z + 0.03038195530554957;
    series = series * z + 0.04464285705150488;
    series = series * z + 0.07500000000029207;
    series = series * z + 0.16666666666666652;
    double phase = sine + sine * z * series;
    phase = far ? phase + PI / 6.0 : phase;
    phase = y > x ? 0.5 * PI - phase : phase;
    return cos < 0.0 ? PI - phase : phase;
}

/* arcsine.py: phase_of */
static KERNEL_INLINE inline double phase_of(double cos, double sin) {
    double phase = phase_above(cos, fabs(sin));
    phase = sin < 0.0 ? FULL_TURN - phase : phase;
    return phase >= FULL_TURN ? 0.0 : phase;
}
#endif
