"""Freed memory is kept for the next arrays."""

from functools import cache

KEPT_BYTES = 16 * 2**20


@cache
def keep_freed_memory() -> None:
    """Make the C library keep the memory of temporary arrays for the next arrays; a second call does nothing.

    The arrays of a block are just large enough that glibc gets fresh pages from the system for each array and returns them when
    the array is freed: over a thousand page faults per frame, a third of the time. The first array here, which is larger, changes
    that when it is freed: from then on glibc takes arrays up to its size from memory that it keeps, and keeps up to twice that
    size. The second array already comes from that memory. For an array of its size, numpy asks Linux for huge pages, and the
    smaller arrays after it lie in these. That is faster when a file is written past the page cache, because such a write looks up
    each page that it reads. No page of the two arrays is touched here.
    """
    import numpy as np

    for _ in range(2):
        np.empty(KEPT_BYTES, np.uint8)
