"""What is told from the bus alone, from frames that cantools has packed."""

import io

import pytest
from rich.console import Console
from support.bus_frames import frame

from canroll import dbc
from canroll.cli.watch import view
from canroll.hil.watch.observation import Observation
from canroll.plant_sim.can_bus.wire.frame import EXTENDED, REMOTE, length_of, worst_case_bits
from canroll.reaction.fault_codes import FAULT_CODES


@pytest.fixture
def seen():
    observation = Observation(500_000)
    for k in range(300):
        t = 0.01 * k
        observation.see(t, frame("Imu", RollRate=-1.5, LateralAcceleration=2.5))
        if k % 4 == 0:
            observation.see(t, frame("SuspensionForceCommand", Mode=1))
        if k % 10 == 0:
            observation.see(t, frame("RollControlStatus", Mode=1, RollAngleEstimate=0.5,
                                     MomentCommand=-1200))  # fmt: skip
    return observation


def test_mode_angles_and_rates(seen):
    summary = seen.summary()
    assert summary["mode"] == "ACTIVE"
    assert summary["roll_estimate_deg"] == pytest.approx(0.5)
    assert summary["moment_command_nm"] == pytest.approx(-1200)
    assert summary["roll_rate_deg_s"] == pytest.approx(-1.5)
    assert summary["command"] == "SuspensionForceCommand"
    assert summary["commands_per_sample"] == pytest.approx(0.25, abs=0.01)
    assert summary["moment_delivered_nm"] == [None, None]
    assert summary["frames"]["Imu"] == 300


def test_the_load_counts_stuff_bits_and_the_interframe_space(seen):
    frames_a_second = seen.rate("Imu") * 1.35
    least = frames_a_second * (47 + 64) / 500_000
    most = frames_a_second * sum(worst_case_bits(8)) / 500_000
    assert least < seen.load < most


def test_a_silent_bus_has_no_rates(seen):
    seen.pass_time(10.0)
    assert seen.load == 0.0
    assert seen.trigger_rate is None
    assert seen.summary()["mode"] == "ACTIVE"


def test_fault_codes_in_words():
    observation = Observation(500_000)
    message = dbc.load().get_message_by_name("RollControlDiagnostics")
    for page in (
        {"Page": 0, "ActiveFaultCodes": 1 << 16},
        {"Page": 1, "LatchedFaultCodes": 1 << 16 | 1 << 6},
    ):
        payload = message.encode({"Checksum": 0, "Counter": 0, **page})
        observation.see(0.0, (message.frame_id, payload))
    assert observation.fault_codes == ["tick missed"]
    assert observation.latched_fault_codes == ["roll rate", "tick missed"]


def test_a_late_message_is_named():
    assert FAULT_CODES[0] == "Imu late"
    assert FAULT_CODES[3] == "ActuatorState late"


def test_extended_and_remote_frames_only_load_the_bus():
    """An identifier of the contract with 29 bits, or asked for, is not of the contract."""
    observation = Observation(500_000)
    ident, payload = frame("RollControlStatus", Mode=1)
    observation.see(0.0, (ident, payload), EXTENDED)
    observation.see(0.1, (ident, b""), REMOTE)
    summary = observation.summary()
    assert summary["mode"] is None
    assert summary["frames"] == {"0x00000300": 1, "0x300": 1}
    observation.pass_time(1.0)
    bits = [length_of(ident, payload, EXTENDED), length_of(ident, b"", REMOTE)]
    assert observation.load == pytest.approx(sum(map(sum, bits)) / 500_000)


def test_delays_are_those_between_frames():
    """Imu at 0 and 10 ms, a command at 13 ms, its acknowledgement at 21 ms, another at 31 ms."""
    observation = Observation(500_000)
    for t, name, signals in (
        (0.000, "Imu", {}),
        (0.010, "Imu", {"Counter": 1}),
        (0.013, "SuspensionForceCommand", {"Counter": 7}),
        (0.020, "ActuatorState", {"AcceptedCounter": 6}),
        (0.021, "ActuatorState", {"Counter": 1, "AcceptedCounter": 7}),
        (0.031, "ActuatorState", {"Counter": 2, "AcceptedCounter": 7}),
    ):
        observation.see(t, frame(name, **signals))
    summary = observation.summary()
    assert summary["imu_to_command_ms"] == pytest.approx({"median": 3.0, "max": 3.0})
    assert summary["command_to_acknowledgement_ms"] == pytest.approx({"median": 8.0, "max": 8.0})
    observation.pass_time(3.0)
    assert observation.summary()["imu_to_command_ms"] is None


def test_a_command_long_after_the_last_sample_does_not_answer_it():
    observation = Observation(500_000)
    observation.see(0.0, frame("Imu"))
    observation.see(0.2, frame("SuspensionForceCommand"))
    assert observation.summary()["imu_to_command_ms"] is None


def test_frames_that_a_counter_skips_are_missing():
    observation = Observation(500_000)
    for t, counter in ((0.00, 13), (0.01, 14), (0.02, 0), (0.05, 3), (0.06, 3), (5.0, 9)):
        observation.see(t, frame("Imu", Counter=counter))
    assert observation.summary()["missing"] == {"Imu": 2}


def test_foreign_and_broken_frames_do_no_harm():
    observation = Observation(500_000)
    observation.see(0.0, (0x123, b"\x01"))
    observation.see(0.1, (0xA0, b""))
    summary = observation.summary()
    assert summary["frames"]["0x123"] == 1
    assert summary["undecoded"] == 1
    assert summary["mode"] is None


def test_everything_is_on_the_screen(seen):
    out = io.StringIO()
    Console(file=out, width=80).print(view(seen.summary(), seen))
    text = out.getvalue()
    for piece in ("ACTIVE", "+0.50°", "-1200 N·m", "0.25", "Imu", "none"):
        assert piece in text
    Console(file=out).print(view(Observation(500_000).summary(), Observation(500_000)))
    assert "no controller" in out.getvalue()
