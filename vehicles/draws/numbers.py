"""A vehicle with other numbers at the keys of its file, and what must follow from them."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from canroll.vehicles import Vehicle
from canroll.vehicles.roll_stiffness import springs_within

MARGIN = 1e-3
"""Distance, relative, from what is impossible."""


def applied(vehicle: Vehicle, values: Mapping[str, float]) -> Vehicle:
    """Return :func:`with_numbers`, with springs no stiffer than the roll stiffness permits.

    Raises:
        CanrollError: the tyres alone are softer in roll than the car.
    """
    return springs_within(with_numbers(vehicle, values))


def with_numbers(vehicle: Vehicle, values: Mapping[str, float]) -> Vehicle:
    """Return ``vehicle`` with the ``values`` of its keys, unchecked.

    The pitch inertia, which steering does not show, follows where it must: it is one that a body
    with the other two inertias can have.
    """
    alike = vehicle.design == vehicle.plant
    for key, value in values.items():
        vehicle = _changed(vehicle, key.split("."), value)
    yaw, roll = vehicle.sprung_yaw_inertia, vehicle.plant.inertia_about_cg
    least, most = (1.0 + MARGIN) * abs(yaw - roll), (1.0 - MARGIN) * (yaw + roll)
    pitch = min(max(vehicle.mass.pitch_inertia, least), most)
    if pitch != vehicle.mass.pitch_inertia:
        vehicle = _changed(vehicle, ["mass", "pitch_inertia"], pitch)
    return replace(vehicle, design=vehicle.plant) if alike else vehicle


def _changed(record: Any, path: list[str], value: float) -> Any:  # noqa: ANN401
    """Return ``record``, dataclasses with tuples in them, with the number at ``path`` replaced."""
    name, *rest = path
    if isinstance(record, tuple):
        return tuple(value if i == int(name) else item for i, item in enumerate(record))
    inner = _changed(getattr(record, name), rest, value) if rest else value
    return replace(record, **{name: inner})
