"""Faults and conditions of sensors and actuators, as written on a command line."""

from collections.abc import Iterable, Mapping
from math import inf, isfinite
from typing import Any

from canroll.errors import CanrollError, UnknownNameError
from plant_sim.nodes import actuators as actuator_setup
from plant_sim.nodes import sensors as sensor_setup
from plant_sim.nodes.actuators import ActuatorFault, ActuatorOptions
from plant_sim.nodes.sensors import SensorFault, SensorOptions

FAULT_FORM = "write WHERE=KIND, WHERE=KIND@START:END or WHERE=KIND:VALUE@START:END"
SENSOR_CONDITIONS = (
    *("noise", "bias", "temperature", "drift"),
    *("filtered", "delayed", "synchronous"),
)
ACTUATOR_CONDITIONS = ("estimate_error", "estimate_lag", "oil_temperature", "supply")
SIGNED = ("temperature", "oil_temperature", "estimate_error")
SWITCHES = {"on": True, "off": False, "true": True, "false": False, "1": True, "0": False}
NEEDS_VALUE = ("offset", "burst")
TAKES_VALUE = (*NEEDS_VALUE, "weak")


def options(
    faults: Iterable[str] = (), conditions: Mapping[str, Any] | None = None
) -> tuple[SensorOptions, ActuatorOptions]:
    """Return the options of sensors and actuators.

    Args:
        faults: "Imu.RollRate=stuck@3:5" or "front_left=weak:0.3@2": signal or corner, kind, value
            (SI units), start and end, s.
        conditions: numeric and boolean fields of ``SensorOptions`` and ``ActuatorOptions`` by name,
            and "phases.<message>" and "lsb.<signal>".

    Raises:
        CanrollError: an invalid fault or condition; the message names the expected form.
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
    found = [fault(text) for text in faults]
    return (
        SensorOptions(**sensors, faults=tuple(f for f in found if isinstance(f, SensorFault))),
        ActuatorOptions(
            **actuators, faults=tuple(f for f in found if isinstance(f, ActuatorFault))
        ),
    )


def condition_names() -> tuple[str, ...]:
    """Return the names of the conditions."""
    return (*SENSOR_CONDITIONS, *ACTUATOR_CONDITIONS, "phases.<message>", "lsb.<signal>")


def fault(text: str) -> SensorFault | ActuatorFault:
    """Return the sensor or actuator fault described by ``text``.

    Raises:
        CanrollError: the text cannot be parsed.
        UnknownNameError: no such signal, corner or kind.
    """
    where, equals, rest = text.partition("=")
    what, at, when = rest.partition("@")
    kind, colon, amount = what.partition(":")
    if not (where and equals and kind) or (at and not when) or (colon and not amount):
        raise CanrollError(f"fault '{text}': {FAULT_FORM}")
    at_sensor = "." in where
    if at_sensor:
        sensor_setup.signal_channel(where)
    elif where not in actuator_setup.CORNERS:
        raise UnknownNameError("corner", where, actuator_setup.CORNERS)
    kinds = sensor_setup.FAULTS if at_sensor else actuator_setup.FAULTS
    if kind not in kinds:
        raise UnknownNameError(f"fault of {where}", kind, kinds)
    if amount and kind not in TAKES_VALUE:
        raise CanrollError(f"fault '{text}': {kind} does not take a value")
    if kind in NEEDS_VALUE and not amount:
        raise CanrollError(f"fault '{text}': {kind} needs a value in SI units, e.g. {kind}:0.1")
    first, _, last = when.partition(":")
    try:
        start, end = float(first or 0.0), float(last or inf)
        value = {"value": float(amount)} if amount else {}
    except ValueError as error:
        raise CanrollError(f"fault '{text}': {FAULT_FORM}") from error
    if not 0 <= start < end or not isfinite(start):
        raise CanrollError(f"fault '{text}': START must be 0 or later and before END")
    if not isfinite(value.get("value", 0.0)):
        raise CanrollError(f"fault '{text}': the value must be finite")
    if kind == "weak" and not 0 <= value.get("value", 0.5) <= 1:
        raise CanrollError(f"fault '{text}': weak needs the fraction of force delivered, 0 to 1")
    if at_sensor:
        return SensorFault(signal=where, kind=kind, start=start, end=end, **value)
    return ActuatorFault(corner=where, kind=kind, start=start, end=end, **value)


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
