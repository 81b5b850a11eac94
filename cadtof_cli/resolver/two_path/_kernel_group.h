/* The basis of the whole kernel: groups of pixels, and arithmetic that gives the same bits on every machine; see
 * _kernel_frame.h. */
#ifndef KERNEL_GROUP_H
#define KERNEL_GROUP_H
#include <float.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "_arcsine.h"

#ifndef GROUP
#define GROUP 32
#endif
#define EACH_PIXEL for (int i = 0; i < GROUP; i++)

/* One value per pixel of a group. */
typedef double Row[GROUP];
typedef float FloatRow[GROUP];

#define INLINE static inline KERNEL_INLINE

/* How many pixels form the next group if so many are left. */
INLINE int in_group(int64_t left) { return left < GROUP ? (int)left : GROUP; }

INLINE double at_least(double value, double low) { return value < low ? low : value; }   /* numpy.maximum: NaN stays NaN */
INLINE double at_most(double value, double high) { return high < value ? high : value; } /* numpy.minimum */
INLINE float at_least_f(float value, float low) { return value < low ? low : value; }
INLINE float at_most_f(float value, float high) { return high < value ? high : value; }

INLINE int any(const double *restrict row) {
    int64_t found = 0;
    EACH_PIXEL found |= row[i] > 0.0;
    return found != 0;
}
#endif
