"""Types used by many modules."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Progress = Callable[[str, float], None]
"""Called with the name of the activity and the share done, 0 to 1."""
