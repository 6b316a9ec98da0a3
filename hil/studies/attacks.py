"""Attacks on an unauthenticated bus, and what the envelopes and the plausibility checks bound.

python -m hil.studies.attacks     prints the table of docs/security.md
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import degrees

import numpy as np

from hil.runs.experiment import drive, plan
from hil.runs.trace import Trace

SCENARIO = "double_lane_change"
ATTACKS = (
    ("none", ()),
    ("command, front", ("attacker.AntiRollBarCommand.TorqueFront=spoof:2000@2",)),
    (
        "command, both axles",
        (
            "attacker.AntiRollBarCommand.TorqueFront=spoof:2000@2"
            " + attacker.AntiRollBarCommand.TorqueRear=spoof:2000@2",
        ),
    ),
    ("command, replayed", ("attacker.AntiRollBarCommand=replay:0.5@2",)),
    ("command, wrong length", ("attacker.AntiRollBarCommand=wrong_length:4@2",)),
    ("acceleration", ("attacker.Imu.LateralAcceleration=spoof:6@2",)),
    ("roll rate", ("attacker.Imu.RollRate=spoof:0.5@2",)),
    ("Imu, replayed", ("attacker.Imu=replay:0.5@2",)),
    ("Imu, wrong length", ("attacker.Imu=wrong_length:4@2",)),
)
"""Attacks by name, as ``--fault`` has them."""
WRONG_SIDE = 500.0
"""Moment outward from which it counts, N·m."""
JUDGED_ABOVE = 1.0
"""Lateral acceleration above which a moment has a side, m/s²."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What an attack did: largest roll (deg), largest moment outward (N·m), time outward (s).

    ``refused``: time for which the actuators' envelope did not follow the command, s; ``codes``:
    fault codes of the ECU.
    """

    name: str
    roll: float
    outward: float
    seconds: float
    refused: float
    codes: tuple[int, ...]


def outcome(name: str, trace: Trace) -> Outcome:
    """Return the figures of a run under attack."""
    signals = trace.signals
    moment = signals["moment_front"] + signals["moment_rear"]
    side = np.where(np.abs(signals["ay"]) > JUDGED_ABOVE, moment * np.sign(signals["ay"]), -np.inf)
    seen = int(np.bitwise_or.reduce(trace.ticks["fault_codes"]))
    return Outcome(
        name,
        degrees(float(np.abs(signals["roll"]).max())),
        max(float(side.max()), 0.0),
        1e-3 * float(np.sum(side > WRONG_SIDE)),
        1e-3 * float(np.sum(signals["envelope"])),
        tuple(code for code in range(32) if seen >> code & 1),
    )


def outcomes() -> Iterator[Outcome]:
    """Drive the manoeuvre under each attack, and without control at last."""
    for name, faults in ATTACKS:
        settings, controller = plan(SCENARIO, faults=faults)
        yield outcome(name, drive(settings, controller, enabled=True))
    settings, controller = plan(SCENARIO)
    yield outcome("without control", drive(settings, controller, enabled=False))


def table() -> list[str]:
    """Return the table of docs/security.md."""
    rows = [
        "| attack | largest roll | moment outward | for | refused by the actuators | codes |",
        "| --- | ---: | ---: | ---: | ---: | --- |",
    ]
    for its in outcomes():
        codes = ", ".join(map(str, its.codes)) or "none"
        rows.append(
            f"| {its.name} | {its.roll:.2f}° | {its.outward:.0f} N·m | {its.seconds:.2f} s "
            f"| {its.refused:.2f} s | {codes} |"
        )
    return rows


if __name__ == "__main__":
    print("\n".join(table()))
