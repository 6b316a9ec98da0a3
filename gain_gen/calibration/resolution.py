"""Steps of what the loop reads and sends, from the frames of its bus."""

from dataclasses import fields
from functools import cache
from math import ldexp

from canroll import dbc
from canroll.codegen.generated.bus_map import BusMap, load
from canroll.codegen.generated.mapped_signal import MappedSignal
from canroll.errors import CanrollError
from canroll.gain_gen.calibration.calibration_file import LoadedCalibration
from canroll.gain_gen.models.task import Resolution

MANTISSA = 23
"""Bits behind the point of a floating-point signal."""


@cache
def of_contract() -> Resolution:
    """Return the steps of ``roll_control.dbc``."""
    return of_bus(load(dbc.PATH, dbc.PATH.with_suffix(".toml")))


def of_bus(bus: BusMap) -> Resolution:
    """Return the steps of the frames of a bus; of an array's elements the largest.

    Of signals that are added, the smallest is that of their sum.
    """
    largest = {field.name: 0.0 for field in fields(Resolution)}
    for box in bus.frames:
        summed = {signal.place.text for signal in box.signals if signal.added}
        for text in dict.fromkeys(s.place.text for s in box.signals if not s.place.mask):
            name = text.partition("[")[0]
            steps = [_step(signal) for signal in box.signals if signal.place.text == text]
            if name in largest:
                step = min(steps) if text in summed else max(steps)
                largest[name] = max(largest[name], step)
    return Resolution(**largest)


def _step(signal: MappedSignal) -> float:
    """Return the step of a signal in its field's unit; of a real one that of its largest value."""
    units = signal.place.hi / 2**MANTISSA if signal.real else float(abs(signal.scale))
    return ldexp(units, -signal.place.q)


def of_calibration(calibration: LoadedCalibration) -> Resolution | None:
    """Return the steps that a calibration is designed for; None where its file has none.

    Raises:
        CanrollError: the table is not one of steps.
    """
    table = calibration.tables["design"].get("resolution")
    if table is None:
        return None
    names = {field.name for field in fields(Resolution)}
    good = isinstance(table, dict) and set(table) == names
    if not good or not all(isinstance(step, float) and step >= 0.0 for step in table.values()):
        wanted = ", ".join(sorted(names))
        raise CanrollError(f"{calibration.path}: [design] resolution must have numbers of {wanted}")
    return Resolution(**table)
