"""The Magic Formula's kernel as a function at an address: importing this compiles it."""

import numpy as np

from canroll.plant_sim.bodies.magic_formula import LINK, forces_of_tyre
from canroll.plant_sim.kernels.jit import cfunc, record_at
from canroll.typing import Vector
from canroll.vehicles.tyres.magic_formula import MagicFormula

_tyre_at = record_at(np.dtype([(name, "f8") for name in MagicFormula.NUMBERS]))


@cfunc("void(int64, f8[::1])")
def step(tyre: int, numbers: Vector) -> None:
    """Replace load, slips, camber, friction and hand in ``numbers`` by forces and moment."""
    numbers[0], numbers[1], numbers[2] = forces_of_tyre(
        _tyre_at(tyre), numbers[0], numbers[1], numbers[2], numbers[3], numbers[4], numbers[5]
    )


LINK.word.value = step.address  # type: ignore[attr-defined]
