"""Manoeuvres of extensions: their plans are checked before the driver's kernel reads them."""

from collections.abc import Callable
from dataclasses import fields, replace
from functools import wraps
from inspect import Parameter, signature
from math import isfinite
from typing import Any

import numpy as np

from canroll.errors import CanrollError
from canroll.extension import guarded
from canroll.plant_sim.driving.drive import ManeuverKind, ManeuverPlan
from canroll.plant_sim.driving.driver import ACCELERATION_TABLE, FISHHOOK, FOLLOW_PATH, STEER_TABLE
from canroll.vehicles import Vehicle

KINDS = (FOLLOW_PATH, STEER_TABLE, ACCELERATION_TABLE, FISHHOOK)
ROWS = ("table", "bank", "grade", "wind", "pedal", "speed")
LONGEST = 600.0
"""Longest manoeuvre, s: its signals are kept in memory, a value a millisecond."""


def accept(what: str, kind: object) -> ManeuverKind:
    """Wrap an extension's manoeuvre so that its plans are checked.

    Args:
        what: kind of object, for error messages.
        kind: the manoeuvre.

    Raises:
        CanrollError: not a manoeuvre, or invalid figures or plan signature.
    """
    if not isinstance(kind, ManeuverKind):
        raise CanrollError(f"{what}: a {type(kind).__name__}, it must be a Kind")
    if not 5.0 <= kind.speed_kmh <= kind.fastest_kmh <= 300.0:
        raise CanrollError(
            f"{what}: speeds of {kind.speed_kmh:g} and at most {kind.fastest_kmh:g} km/h: they "
            "must be in order, 5 to 300"
        )
    plan = guarded(what, kind.plan, 3, ManeuverPlan)
    for option in signature(kind.plan).parameters.values():
        is_plain = isinstance(option.default, bool | float | str)
        if option.kind is Parameter.KEYWORD_ONLY and not is_plain:
            raise CanrollError(
                f"{what}: option {option.name} needs a default that is a bool, float or str"
            )
    return replace(kind, plan=_checked(what, plan))


def _checked(what: str, plan: Callable[..., ManeuverPlan]) -> Callable[..., ManeuverPlan]:
    @wraps(plan)
    def call(vehicle: Vehicle, speed: float, seed: int, **options: Any) -> ManeuverPlan:  # noqa: ANN401
        planned = plan(vehicle, speed, seed, **options)
        try:
            check_plan(planned)
        except CanrollError as error:
            raise CanrollError(f"{what}: {error}") from error
        return planned

    return call


def check_plan(plan: ManeuverPlan) -> None:
    """Refuse a plan that the driver's kernel cannot drive.

    Raises:
        CanrollError: the message names the field.
    """
    if not 0.0 < plan.duration <= LONGEST:
        raise CanrollError(f"duration {plan.duration:g} s: it must be above 0, at most {LONGEST:g}")
    if plan.kind not in KINDS:
        raise CanrollError(f"kind {plan.kind}: it must be one of {', '.join(map(str, KINDS))}")
    if plan.kind == FOLLOW_PATH and plan.path_xy is None:
        raise CanrollError("path_xy is missing: kind FOLLOW_PATH follows it")
    if plan.kind in (STEER_TABLE, ACCELERATION_TABLE) and plan.table is None:
        raise CanrollError("table is missing: its kind plays it back")
    for field in fields(plan):
        value = getattr(plan, field.name)
        if field.name in ("table_step", "road_step") and not 0.0 < value < np.inf:
            raise CanrollError(f"{field.name} {value:g}: it must be above 0")
        if field.name in ROWS and value is not None:
            _row(field.name, value, 1)
        if field.name in ("path_xy", "road", "friction") and value is not None:
            if len(value) != 2 or np.shape(value[0]) != np.shape(value[1]):
                raise CanrollError(f"{field.name} must be two arrays of one length")
            for row in value:
                _row(field.name, row, 2 if field.name == "path_xy" else 1)
    if len(plan.fishhook) != 4 or not all(map(isfinite, plan.fishhook)):
        raise CanrollError("fishhook must be four finite numbers")
    if not plan.steer_rate >= 0.0:
        raise CanrollError(f"steer_rate {plan.steer_rate:g}: it must not be negative")


def _row(name: str, values: object, least: int) -> None:
    if not isinstance(values, np.ndarray) or values.dtype != float or values.ndim != 1:
        raise CanrollError(f"{name} must hold float64 arrays of one dimension")
    if len(values) < least or not values.flags.c_contiguous or not np.isfinite(values).all():
        raise CanrollError(f"{name}: at least {least} finite values, contiguous")
