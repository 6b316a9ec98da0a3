"""What is told from the bus alone, from frames that cantools has packed."""

import io

import pytest
from rich.console import Console

import dbc
from hil.cli.watch import view
from hil.realtime.observation import Observation
from plant_sim.can_bus.wire.frame import worst_case_bits


def frame(name, **signals):
    message = dbc.load().get_message_by_name(name)
    values = {s.name: 0 for s in message.signals if not s.is_multiplexer and not s.multiplexer_ids}
    return message.frame_id, message.encode(values | signals, strict=True)


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


def test_troubles_in_words():
    observation = Observation(500_000)
    message = dbc.load().get_message_by_name("RollControlDiagnostics")
    payload = message.encode(
        {"Checksum": 0, "Counter": 0, "Page": 0, "ActiveTroubles": 1 << 16,
         "LatchedTroubles": 1 << 16 | 1 << 6},
    )  # fmt: skip
    observation.see(0.0, (message.frame_id, payload))
    assert observation.troubles == ["tick missed"]
    assert observation.latched_troubles == ["roll rate", "tick missed"]


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
