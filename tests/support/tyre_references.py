"""Forces of Magic Formula tyres by two public implementations, over a grid of 10⁴ points.

None of their code is here; values that they gave are kept as the references of a test.

- MFeval of M. Furlan (MathWorks File Exchange 63618), versions 5.2, 6.1 and 6.2, in GNU Octave. Its
  ``Solver.m`` and ``readTIR.m`` as in https://github.com/LHRIC/Vogel_SIM (GPL-3.0), commit 183525f.
- TyreDyn of N. van Rossem, https://github.com/NiekvanRossem/TyreDyn (MIT), commit 4b10d78, versions
  6.1 and 6.2, in Python.

Where they differ from each other or from us:

- MFeval has cos(α*) with α* = tan α in the residual moment, where its own default mode and TyreDyn
  have cos α: negative above 57°. The value here has cos α.
- Both keep denominators finite by small numbers; TyreDyn scales friction in vertical shifts by
  (4.E8) with A = 10, which is 1 here and in MFeval, and has the pressure's sign in the camber
  stiffness (4.E30) inverted: both are set right on it.
- The aligning moment of TyreDyn is not compared: it has 2/π inverted in the trail's curvature, no
  camber in the stiffness of the residual's shift, cos² α, and LYKA in the place of LKY.
"""

from itertools import product
from math import radians

import numpy as np
from numpy.typing import NDArray

Grid = NDArray[np.float64]

LOADS = (300.0, 2000.0, 4000.0, 6500.0, 8800.0)
RATIOS = (-1.0, -0.5, -0.15, -0.05, -0.01, 0.0, 0.02, 0.08, 0.3, 1.0)
ANGLES = (-25.0, -12.0, -6.0, -3.0, -1.0, 0.0, 0.5, 2.0, 5.0, 15.0)
CAMBERS = (-0.15, -0.05, 0.0, 0.04, 0.12)
PRESSURES = (200e3, 220e3, 240e3, 290e3)
SPEED = 200.0
"""Speed (m/s), on which only those small numbers depend."""
KEPT = 7
"""Every such point of the grid is kept."""


def grid() -> Grid:
    """Load (N), slip ratio, slip angle and camber (rad, axes of the file), pressure (Pa)."""
    angles = [radians(angle) for angle in ANGLES]
    return np.array(list(product(LOADS, RATIOS, angles, CAMBERS, PRESSURES)))
