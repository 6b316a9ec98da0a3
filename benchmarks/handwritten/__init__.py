"""The tick of constant-gain state feedback, written by hand in C on the generated records.

It does what the generated firmware does for a calibration of ``canroll run --no-watch-response``
(lqr, ay_feedforward: suspension forces, both sensors, event trigger, E2E, the other monitors), bit
for bit, and nothing for options that such a calibration leaves off. Held against the generated C it
shows what being general costs.
"""

from pathlib import Path

import numpy as np

from canroll.codegen.c99 import emit
from canroll.firmware.calibration import CONSTANT_GAIN, STATE_FEEDBACK, SUSPENSION
from canroll.firmware.state import RX_ACTUATOR_STATE, RX_IMU, RX_VEHICLE_MOTION

# what only options that are off would read
LEFT_OUT = ("work", "detected", "rate_good")
OPTIONS = {
    "law": STATE_FEEDBACK,
    "actuator": SUSPENSION,
    "observer": CONSTANT_GAIN,
    "measurements": 3,
    "identification": 0,
    "offset_learning": 0,
    "event_trigger": 1,
    "e2e": 1,
    "response_min": 0,
}
MODEL = np.array(
    [[1, 1, 1, 1, 0], [1, 1, 1, 1, 0], [0, 0, 1, 1, 0], [0, 0, 1, 1, 0], [0, 0, 0, 0, 1]], bool
)
MOMENT_LIMIT = 1 << 28


def files():
    """The emitted firmware with its tick and its receive replaced by the hand-written ones."""
    sources = dict(emit.firmware())
    for name, function in (
        ("canroll_ecu.c", "canroll_tick"),
        ("canroll_mailbox.c", "canroll_receive"),
    ):
        sources[name] = without(sources[name], function)
    for path in Path(__file__).parent.glob("*.[ch]"):
        sources[path.name] = path.read_text(encoding="utf-8")
    return sources


def without(text, function):
    """``text`` of a C file without one of its functions."""
    begin = text.index(f"void {function}(")
    return text[:begin] + text[text.index("\n}\n", begin) + 3 :]


def does(record):
    """Whether a calibration is of the configuration that is written by hand."""
    needed = {m for m, ticks in enumerate(record.timeout_ticks) if ticks > 0}
    one = [1 << shift for shift in (record.phi_shift[4], *record.output_shift[:2])]
    output = np.array(record.output)
    return (
        all(getattr(record, name) == value for name, value in OPTIONS.items())
        and needed == {RX_IMU, RX_VEHICLE_MOTION, RX_ACTUATOR_STATE}
        and not np.array(record.phi)[~MODEL].any()
        and not any(record.gamma[2:] + record.gamma_steering + record.output_moment)
        and record.phi[4][4] == one[0]
        and list(output[0]) == [0, one[1], 0, 0, one[1]]
        and list(output[1, 1:]) == [0, one[2], 0, 0]
        and not any(record.feedback[2:] + record.feedforward[:2] + record.feedforward[4:])
        and record.moment_max < MOMENT_LIMIT
        and record.redundancy_min > 0
        and record.delivery_min > 0
    )


def differences(states, others):
    """Names of the fields in which two runs' states differ, without those left out."""
    return [
        name
        for name in states.dtype.names
        if name not in LEFT_OUT and not np.array_equal(states[name], others[name])
    ]
