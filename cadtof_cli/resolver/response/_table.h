/* Where a table of a response holds the answer to a phase; see table.py. */
#ifndef RESPONSE_TABLE_H
#define RESPONSE_TABLE_H
#include <math.h>
#include <stdint.h>

#define ENTRIES (1 << 14) /* entries of a table per turn; an entry is re, im and their slopes */
#define FARTHEST 1e9f     /* entries from phase 0 beyond which a phase takes the entry of 0 */

/* table.py: at. The number of the entry at a whole number of entries from phase 0. */
static KERNEL_INLINE inline int32_t entry_at(float nearest) {
    return (fabsf(nearest) < FARTHEST ? (int32_t)nearest : 0) & (ENTRIES - 1);
}
#endif
