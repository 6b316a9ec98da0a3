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

import subprocess
import sys
from itertools import product
from math import radians
from pathlib import Path
from tempfile import TemporaryDirectory

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

_OCTAVE = """
addpath(argv(){1}); warning('off', 'all');
p = mfeval.readTIR(argv(){2});
out = mfeval.Solver().fullSteadyState(p, dlmread(argv(){3}), 121);
dlmwrite(argv(){4}, out(:, [1 2 6 22]), 'precision', '%.17g');
"""
_CONTAINS = "function r = contains(s, p)\nr = ~isempty(strfind(s, p));\nend\n"


def grid() -> Grid:
    """Load (N), slip ratio, slip angle and camber (rad, axes of the file), pressure (Pa)."""
    angles = [radians(angle) for angle in ANGLES]
    return np.array(list(product(LOADS, RATIOS, angles, CAMBERS, PRESSURES)))


def plain(tir: Path) -> str:
    """Return a tyre file without what other readers stumble over."""
    lines = tir.read_text().replace("\t", " ").splitlines()
    kept = [line for line in lines if line.startswith("[") or ("=" in line and line[0] not in "$!")]
    return "\n".join(kept) + "\n"


def mfeval(folder: Path, tir: Path) -> Grid:
    """F_x, F_y (N) and M_z (N·m) by MFeval, whose package ``+mfeval`` is in ``folder``, (n, 3)."""
    points = grid()
    inputs = np.column_stack(
        [points[:, :4], np.zeros(len(points)), np.full(len(points), SPEED), points[:, 4]]
    )
    with TemporaryDirectory() as place:
        here = Path(place)
        (here / "+mfeval").mkdir()
        for source in (folder / "+mfeval").glob("*.m"):
            lines = source.read_text(errors="replace").splitlines()
            text = "\n".join(line for line in lines if "coder.extrinsic" not in line)
            (here / "+mfeval" / source.name).write_text(text + "\n")
        (here / "contains.m").write_text(_CONTAINS)
        (here / "evaluate.m").write_text(_OCTAVE)
        (here / "tyre.tir").write_text(plain(tir))
        np.savetxt(here / "grid.txt", inputs, fmt="%.17g")
        names = (here / name for name in ("tyre.tir", "grid.txt", "out.txt"))
        command = ["octave-cli", "--no-gui", "-q", here / "evaluate.m", here, *names]
        subprocess.run(command, check=True, stderr=subprocess.DEVNULL)
        out = np.loadtxt(here / "out.txt", delimiter=",")
    cosines = np.cos(points[:, 2]) / np.cos(np.tan(points[:, 2]))
    return np.column_stack([out[:, :2], out[:, 2] + out[:, 3] * (cosines - 1.0)])


def tyredyn(folder: Path, tir: Path) -> Grid:
    """F_x and F_y (N) by TyreDyn, whose repository is ``folder``, (n, 2)."""
    sys.path.insert(0, str(folder))
    from src.initialize_tyre import Tyre  # noqa: PLC0415 - only where it is at hand

    with TemporaryDirectory() as place:
        path = Path(place, "tyre.tir")
        path.write_text(plain(tir))
        quiet = {"print_status": False, "validate": False, "check_limits": False}
        tyre = Tyre(str(path), **quiet)
    tyre._A_mu = tyre.zeta_default = 1.0
    tyre.PPY5 = -tyre.PPY5
    load, ratio, angle, camber, pressure = grid().T
    given = {"FZ": load, "SL": ratio, "SA": angle, "IA": camber, "P": pressure, "N": 60.0}
    speed = np.full(len(load), SPEED)
    ahead = tyre.forces._find_fx_combined(**given, VX=speed)
    aside = tyre.forces._find_fy_combined(**given, VX=speed)
    return np.column_stack([ahead, aside])
