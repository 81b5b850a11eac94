"""Memory that is freed is kept for what comes next."""

from functools import cache

KEPT_BYTES = 16 * 2**20


@cache
def keep_freed_memory() -> None:
    """Let the C library keep the memory of temporary arrays for the next ones; called again, it does nothing.

    A block's arrays are just large enough that glibc asks the system for fresh pages for each and returns them at once: over a
    thousand page faults per frame, a third of the time. It learns otherwise when one larger array is freed: from then on, arrays
    up to that size come from memory that it keeps, and up to twice that much of it. The second array already does, and numpy asks
    Linux for huge pages for arrays of its size, which the smaller ones after it lie in then: a write past the page cache looks up
    each page that it is from. No page of the two is touched.
    """
    import numpy as np

    for _ in range(2):
        np.empty(KEPT_BYTES, np.uint8)
