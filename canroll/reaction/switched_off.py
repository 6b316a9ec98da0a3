"""The same fault without a reaction: what it does by itself.

Harm that is not done without the reaction is the reaction's own. Switched off are the ECU's
monitors, timeouts and envelope, by a calibration whose limits nothing reaches, and the status that
failing actuators report. Frames that their protection refuses stay refused, and the actuators let
go of a command that is not renewed.
"""

from dataclasses import replace

from canroll.firmware.calibration import Calibration
from canroll.firmware.subset import fields
from canroll.gain_gen.calibration.record import fill, identify
from canroll.plant_sim.faults import Fault, kinds, parse

OFF = (
    *("redundancy_min", "clock_period", "erratic_scale", "delivery_min", "rolling_min"),
    *("response_min", "heave_min"),
)
"""Fields by which a monitor is off where they are 0."""
WIDEST = (
    *("roll_rate_max", "acceleration_max", "acceleration_noise"),
    *("speed_noise", "stuck_ticks"),
    *("envelope_age", "envelope_outward", "envelope_ticks"),
)
"""Limits that nothing reaches at the end of their range."""


def unsupervised(record: Calibration) -> Calibration:
    """Return the calibration with which the ECU reacts to no finding of its own."""
    ranges = {field.name: field.f for field in fields(Calibration)}
    values = {name: getattr(record, name) for name in ranges}
    for name in OFF:
        values[name] = [0] * len(values[name]) if isinstance(values[name], list) else 0
    values |= {name: ranges[name].hi for name in WIDEST}
    longest = ranges["timeout_ticks"].hi
    values["timeout_ticks"] = [longest if ticks else 0 for ticks in values["timeout_ticks"]]
    return identify(fill(values))


def unreported(faults: str) -> str:
    """Return the faults, with actuators that report no status of their own failures."""
    failing = [fault for fault in parse(faults) if kinds.PLACES[fault.where] == kinds.ACTUATOR]
    return " + ".join([faults, *(str(_lying(fault)) for fault in failing)])


def _lying(fault: Fault) -> Fault:
    return replace(fault, kind="lying", value=0.0, ramp=0.0)
