"""Forces of one tyre by the model of its axle; data of models: :mod:`canroll.vehicles.tyres`."""

from collections.abc import Callable, Sequence
from importlib import import_module
from math import atan, sin, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.plant_sim.bodies.magic_formula import linked
from canroll.plant_sim.kernels.jit import inlined, njit, record_of
from canroll.vehicles.axles import TYRES
from canroll.vehicles.tyres import LEAST, Similarity, TyreModel
from canroll.vehicles.tyres.magic_formula import MagicFormula

Kernel = Callable[..., tuple[float, float, float]]
Points = NDArray[np.float64]

_similarity = record_of(np.dtype([(name, "f8") for name in Similarity.NUMBERS]))


@inlined
def falling(ratio: float, slope: float) -> float:
    """Factor that falls by ``slope`` for each unit of ``ratio`` = load over static load above 1."""
    return max(1.0 - slope * (ratio - 1.0), LEAST)


@inlined
def similarity(  # noqa: PLR0917
    axle: Any,  # noqa: ANN401
    load: float,
    slip_ratio: float,
    slip_angle: float,
    camber: float,
    friction: float,
    hand: float,
) -> tuple[float, float, float]:
    """Kernel of :class:`canroll.vehicles.tyres.Similarity`: no camber thrust or aligning moment."""
    tyre = _similarity(axle.tyre)
    ratio = load * tyre.per_load
    linear_x = tyre.longitudinal * ratio * slip_ratio
    linear_y = tyre.cornering * ratio * falling(ratio, tyre.cornering_load_slope) * slip_angle
    limit = tyre.friction * friction * falling(ratio, tyre.friction_load_slope) * load
    demand = sqrt(linear_x * linear_x + linear_y * linear_y)
    if not (demand > 0.0 and limit > 0.0):
        return 0.0, 0.0, 0.0
    # magic formula of the resultant, its peak the limit
    slip = demand / (limit * tyre.shape)
    bent = slip - tyre.curvature * (slip - atan(slip))
    share = limit / demand * sin(tyre.shape * atan(bent))
    return share * linear_x, share * linear_y, 0.0


def chosen(kernels: Sequence[Kernel], number: int = 0) -> Kernel:
    """The kernel that calls the one of an axle's ``tyre_model``; the first has ``number``."""
    first = kernels[0]
    if len(kernels) == 1:
        return first
    others = chosen(kernels[1:], number + 1)

    @inlined
    def forces(  # noqa: PLR0917
        axle: Any,  # noqa: ANN401
        load: float,
        slip_ratio: float,
        slip_angle: float,
        camber: float,
        friction: float,
        hand: float,
    ) -> tuple[float, float, float]:
        if axle.tyre_model == number:
            return first(axle, load, slip_ratio, slip_angle, camber, friction, hand)
        return others(axle, load, slip_ratio, slip_angle, camber, friction, hand)

    return forces


KERNELS: tuple[Kernel, ...] = (similarity, linked)
"""One for each of :data:`canroll.vehicles.axles.TYRES`, in their order."""
ROOM = max(len(model.NUMBERS) for model in TYRES.values())
"""Most parameters of a tyre model."""
forces = chosen(KERNELS)
"""``forces(axle, load, slip_ratio, slip_angle, camber, friction, hand)``.

See :mod:`canroll.vehicles.tyres`; ``hand`` is 1 on the left and -1 on the right.
"""


@njit
def _forces_of(  # noqa: PLR0917
    axle: Any,  # noqa: ANN401
    load: float,
    slip_ratio: float,
    slip_angle: float,
    camber: float,
    friction: float,
    hand: float,
) -> tuple[float, float, float]:
    return forces(axle, load, slip_ratio, slip_angle, camber, friction, hand)


def forces_of(tyre: TyreModel, *arguments: float) -> tuple[float, float, float]:
    """What the kernel of a tyre gives: see :meth:`canroll.vehicles.tyres.TyreModel.forces`."""
    axle = np.zeros(1, [("tyre_model", "f8"), ("tyre", "f8", (ROOM,))])
    fill(axle[0], tyre)
    return _forces_of(axle[0], *map(float, arguments))


@njit
def _forces_over(axle: Any, points: Points, out: Points) -> None:  # noqa: ANN401
    for i in range(len(points)):
        p = points[i]
        out[i, 0], out[i, 1], out[i, 2] = forces(axle, p[0], p[1], p[2], p[3], p[4], p[5])


def forces_over(tyre: TyreModel, points: Points) -> Points:
    """Forces (N) and moment (N·m) of a tyre at many points, (n, 3).

    Args:
        tyre: its model.
        points: arguments of :meth:`canroll.vehicles.tyres.TyreModel.forces` in their order, (n, 6).
    """
    axle = np.zeros(1, [("tyre_model", "f8"), ("tyre", "f8", (ROOM,))])
    fill(axle[0], tyre)
    out = np.empty((len(points), 3))
    _forces_over(axle[0], points, out)
    return out


def fill(axle: Any, tyre: TyreModel) -> None:  # noqa: ANN401
    """Fill an axle's record with the tyre on it."""
    if isinstance(tyre, MagicFormula):
        import_module("canroll.plant_sim.bodies.magic_formula_step")
    axle["tyre_model"] = list(TYRES.values()).index(type(tyre))
    parameters = tyre.parameters
    axle["tyre"][: len(parameters)] = parameters
