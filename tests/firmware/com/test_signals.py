"""Bytes to quantities and back, judged by cantools."""

import numpy as np
import pytest
import rig
from hypothesis import given
from hypothesis import strategies as st

from canroll.firmware.com import signals
from canroll.firmware.state import RX_ACTUATOR_STATE, Ecu
from canroll.firmware.subset import fields

DEG = np.pi / 180
# signal, field, element, factor from the DBC's unit to the field's, fractional bits
RECEIVED = {
    "Imu": [
        ("RollRate", "roll_rate", None, DEG, 27),
        ("LateralAcceleration", "lateral_acceleration", None, 1, 24),
        ("YawRate", "yaw_rate", None, DEG, 27),
    ],
    "VehicleMotion": [
        ("VehicleSpeed", "speed", None, 1 / 3.6, 20),
        ("SteeringWheelAngle", "steering", None, DEG, 24),
    ],
    "SuspensionRate": [
        (f"Rate{c}", "stroke_rate", i, 1e-3, 27)
        for i, c in enumerate(("FrontLeft", "FrontRight", "RearLeft", "RearRight"))
    ],
    "ActuatorState": [
        ("DeliveredMomentFront", "delivered", 0, 1, 14),
        ("DeliveredMomentRear", "delivered", 1, 1, 14),
    ],
    "RollReference": [
        ("RollAngle", "reference_roll", None, DEG, 30),
        ("RollRate", "reference_rate", None, DEG, 27),
        ("LateralAcceleration", "reference_acceleration", None, 1, 24),
    ],
}


def stored(ecu: Ecu, name: str, element: int | None) -> int:
    value = getattr(ecu, name)
    return value if element is None else value[element]


@pytest.mark.parametrize("name", RECEIVED)
@given(st.binary(min_size=8, max_size=8))
def test_any_bytes_unpack_to_what_cantools_decodes(name, payload):
    message = rig.DATABASE.get_message_by_name(name)
    number = signals.RX_IDS.index(message.frame_id)
    values = message.decode(payload, decode_choices=False, scaling=True)
    raw = message.decode(payload, decode_choices=False, scaling=False)
    ecu = Ecu()
    ecu.rx_payload[1] = list(payload)
    signals.unpack(ecu, number, 1)
    for bit, (signal, name_of_field, element, factor, q) in enumerate(RECEIVED[name]):
        description = message.get_signal_by_name(signal)
        reserved = [int(code) for code, text in (description.choices or {}).items()]
        field = next(f for f in fields(Ecu) if f.name == name_of_field)
        assert (ecu.valid[number] >> bit & 1) == (raw[signal] not in reserved)
        if raw[signal] in reserved:
            assert stored(ecu, name_of_field, element) == 0
            continue
        exact = np.clip(values[signal] * factor * 2.0**q, field.f.lo, field.f.hi)
        tolerance = 0.5 + abs(exact) * 2e-9
        assert abs(stored(ecu, name_of_field, element) - exact) <= tolerance


STATUS_BYTES = st.tuples(*[st.integers(0, 3)] * 4)


@given(STATUS_BYTES, st.integers(0, 1), st.integers(0, 1), st.integers(0, 15))
def test_actuator_state_flags_arrive(status, enabled, held, counter):
    ecu = Ecu()
    values = rig.ACTUATOR_OK | {
        "StatusFrontLeft": status[0],
        "StatusFrontRight": status[1],
        "StatusRearLeft": status[2],
        "StatusRearRight": status[3],
        "Enabled": enabled,
        "CommandHeld": held,
        "AcceptedCounter": counter,
    }
    ecu.rx_payload[0] = list(rig.Sender().frame("ActuatorState", **values))
    signals.unpack(ecu, RX_ACTUATOR_STATE, 0)
    assert tuple(ecu.status) == status
    assert (ecu.enabled, ecu.command_held, ecu.accepted_counter) == (enabled, held, counter)


COMMANDS = {
    0: ("force", 4, rig.FORCES, 2.0, 4090.0),
    1: ("bar", 2, ("TorqueFront", "TorqueRear"), 0.25, 8191.0),
    2: (
        "current",
        4,
        ("CurrentFrontLeft", "CurrentFrontRight", "CurrentRearLeft", "CurrentRearRight"),
        0.5,
        2046.5,
    ),
    3: ("current", 2, ("CurrentFront", "CurrentRear"), 0.5, 16382.0),
}


@pytest.mark.parametrize("slot", COMMANDS)
@given(st.data())
def test_packed_commands_read_back_within_half_a_step(slot, data):
    name, count, names, step, limit = COMMANDS[slot]
    lowest = 0.0 if slot == 2 else -limit
    values = data.draw(st.lists(st.floats(lowest, limit), min_size=count, max_size=count))
    mode = data.draw(st.integers(0, 3))
    ecu = Ecu()
    ecu.mode = mode
    for k, value in enumerate(values):
        getattr(ecu, name)[k] = round(value * 2**14)
    signals.pack(ecu, slot)
    frame = rig.decoded(slot, ecu.tx_payload[slot])
    assert frame["Mode"] == mode
    for k, value in enumerate(values):
        assert abs(frame[names[k]] - value) <= step / 2 + 2**-14
