"""The types of the arrays of the suite; their shapes and units are in the docstrings."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
