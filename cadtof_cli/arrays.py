"""Names for the array types that pass between the stages."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Stored = NDArray[Any]
"""Values as a file holds them: any integer or float type, axes H C Y X (or H C n for a block of pixels)."""

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]
Complex = NDArray[np.complex128]
Bool = NDArray[np.bool_]
Index = NDArray[np.intp]
Status = NDArray[np.uint32]
