"""How this process gives memory back to the system: seldom."""

from functools import lru_cache

import numpy as np

KEPT_BYTES = 16 * 2**20


@lru_cache(maxsize=1)
def keep_freed_memory() -> None:
    """Let the C library keep the memory of temporary arrays for the next ones; called again, it does nothing.

    A block's arrays are just large enough that glibc asks the system for fresh pages for each and returns them at once: over a
    thousand page faults a frame, a third of the time. It learns otherwise when one larger array is freed: from then on, arrays
    up to that size come from memory that it keeps, and up to twice that much of it. No page of this array is touched.
    """
    np.empty(KEPT_BYTES, np.uint8)
