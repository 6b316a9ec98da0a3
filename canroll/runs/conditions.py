"""Faults of a run, and conditions of sensors and actuators, as written on a command line."""

from collections.abc import Mapping
from math import isfinite
from pathlib import Path
from typing import Any

from canroll.errors import CanrollError, UnknownNameError
from canroll.plant_sim.faults import parse_all, read_file
from canroll.plant_sim.nodes import sensors as sensor_setup
from canroll.plant_sim.nodes.actuators import ActuatorOptions
from canroll.plant_sim.nodes.sensors import SensorOptions
from canroll.setup.choice import several

SENSOR_CONDITIONS = (
    *("noise", "noise_end", "bias", "temperature", "drift"),
    *("filtered", "delayed", "synchronous"),
)
ACTUATOR_CONDITIONS = ("estimate_error", "estimate_lag", "oil_temperature", "supply")
SIGNED = ("temperature", "oil_temperature", "estimate_error")
SWITCHES = {"on": True, "off": False, "true": True, "false": False, "1": True, "0": False}


def options(
    conditions: Mapping[str, Any] | None = None,
) -> tuple[SensorOptions, ActuatorOptions]:
    """Return the options of sensors and actuators.

    ``conditions`` are numeric and boolean fields of ``SensorOptions`` and ``ActuatorOptions`` by
    name, and "phases.<message>" and "lsb.<signal>".

    Raises:
        CanrollError: an invalid condition.
    """
    sensors: dict[str, Any] = {"phases": {}, "lsb": {}}
    actuators: dict[str, Any] = {}
    for name, value in (conditions or {}).items():
        group, _, member = name.partition(".")
        if group in ("phases", "lsb") and member:
            if group == "lsb":
                sensor_setup.signal_channel(member)
            elif member not in sensor_setup.NODES:
                raise UnknownNameError("sensor message", member, sensor_setup.NODES)
            sensors[group][member] = _number(name, value)
        elif name in SENSOR_CONDITIONS:
            switch = isinstance(getattr(SensorOptions(), name), bool)
            sensors[name] = _switch(name, value) if switch else _number(name, value)
        elif name in ACTUATOR_CONDITIONS:
            actuators[name] = _number(name, value)
        else:
            raise UnknownNameError("condition", name, condition_names())
    return SensorOptions(**sensors), ActuatorOptions(**actuators)


def fault_texts(choices: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the faults of a run's choices, those of a file as text too.

    Raises:
        CanrollError: an invalid fault; the message names the expected form.
    """
    texts = several(choices.get("faults") or ())
    parse_all(texts)
    path = choices.get("fault_file")
    return texts if path is None else (*texts, *map(str, read_file(Path(path))))


def condition_names() -> tuple[str, ...]:
    """Return the names of the conditions."""
    return (*SENSOR_CONDITIONS, *ACTUATOR_CONDITIONS, "phases.<message>", "lsb.<signal>")


def _number(name: str, value: Any) -> float:  # noqa: ANN401
    try:
        number = float(value)
    except (TypeError, ValueError) as error:
        raise CanrollError(f"condition {name}: {value!r} is not a number") from error
    if not isfinite(number) or (number < 0 and name not in SIGNED):
        least = "" if name in SIGNED else " and not below 0"
        raise CanrollError(f"condition {name}: {number:g} must be finite{least}")
    return number


def _switch(name: str, value: Any) -> bool:  # noqa: ANN401
    text = str(value).lower()
    if text not in SWITCHES:
        raise CanrollError(f"condition {name} must be on or off, got {value!r}")
    return SWITCHES[text]
