"""What browsers are sent of an observation."""

import json

import pytest
from support.bus_frames import frame

import dbc
from hil.watch.observation import Observation
from hil.watch.stream import KEPT, LOAD_WINDOW, LiveStream, state


class Fed:
    """A stream fed with frames at made-up times."""

    def __init__(self):
        self.seen = Observation(500_000)
        self.stream = LiveStream(self.seen)

    def feed(self, *frames, now=None):
        """Take (t, name, signals); the time is the last frame's or ``now``."""
        seen = [self.seen.see(t, frame(name, **signals)) for t, name, signals in frames]
        now = frames[-1][0] if now is None else now
        self.seen.pass_time(now)
        self.stream.add(seen, now)
        return self

    def news(self):
        return json.loads(self.stream.news())

    def everything(self):
        return json.loads(self.stream.everything())


def active(codes):
    return {"Page": 0, "ActiveFaultCodes": codes}


def latched(codes):
    return {"Page": 1, "LatchedFaultCodes": codes}


def test_rows_hold_the_values_of_every_frame():
    fed = Fed().feed(
        (0.00, "Imu", {"RollRate": 1.5, "LateralAcceleration": -2.5}),
        (0.01, "Imu", {"RollRate": 1.0, "LateralAcceleration": -2.5}),
        (0.02, "RollControlStatus", {"RollAngleEstimate": 0.5, "MomentCommand": 800, "Mode": 1}),
        (0.03, "ActuatorState", {"DeliveredMomentFront": 300, "DeliveredMomentRear": 200}),
        (0.04, "VehicleMotion", {"VehicleSpeed": 80, "SteeringWheelAngle": -20}),
    )
    rows = fed.news()["rows"]
    assert rows["imu"] == [[0.0, 1.5, -2.5], [0.01, 1.0, -2.5]]
    assert rows["status"] == [[0.02, 0.5, 800, 1]]
    assert rows["delivered"] == [[0.03, 300, 200]]
    assert rows["motion"] == [[0.04, 80, -20]]
    assert fed.news()["rows"] == {}


def test_a_value_that_is_not_available_is_null():
    ident, payload = frame("Imu")
    imu = dbc.load().get_message_by_name("Imu")
    values = imu.decode(payload, decode_choices=False) | {"RollRate": "Not available"}
    fed = Fed()
    seen = fed.seen.see(0.0, (ident, imu.encode(values, strict=False)))
    fed.stream.add([seen], 0.0)
    assert fed.news()["rows"]["imu"] == [[0.0, None, 0.0]]


def test_delays_are_in_milliseconds():
    rows = Fed().feed(
        (0.000, "Imu", {}),
        (0.004, "SuspensionForceCommand", {"Counter": 3}),
        (0.010, "ActuatorState", {"AcceptedCounter": 3}),
    ).news()["rows"]  # fmt: skip
    assert rows["imu_to_command"] == [[0.004, 4.0]]
    assert rows["command_to_acknowledgement"] == [[0.01, 6.0]]


def test_whoever_joins_late_gets_what_the_others_have():
    fed = Fed()
    rows = []
    for k in range(40):
        fed.feed((0.1 * k, "Imu", {"RollRate": 0.5 * (k % 3), "Counter": k % 15}))
        rows += fed.news()["rows"].get("imu", [])
    whole = fed.everything()
    assert whole["whole"] and not fed.news()["whole"]
    assert whole["rows"]["imu"] == rows
    assert [text for _, text in whole["events"]] == ["vehicle heard"]


def test_what_is_fresh_reaches_a_late_joiner_once():
    """It joined between two messages: what the next one brings is not in its history."""
    fed = Fed().feed((0.0, "Imu", {}))
    fed.news()
    fed.feed((0.01, "Imu", {"Counter": 1}))
    history = fed.everything()["rows"]["imu"]
    assert history + fed.news()["rows"]["imu"] == [[0.0, 0.0, 0.0], [0.01, 0.0, 0.0]]


def test_a_minute_is_kept():
    fed = Fed()
    for k in range(200):
        fed.feed((float(k), "Imu", {}))
        fed.news()
    times = [row[0] for row in fed.everything()["rows"]["imu"]]
    assert times[0] == 199 - KEPT
    assert times[-1] == 199


def test_a_run_that_is_over_stays_in_view():
    fed = Fed().feed((0.0, "Imu", {}), (5.0, "Imu", {}))
    fed.news()
    fed.feed(now=500.0)
    assert fed.news()["now"] == 6.0
    whole = fed.everything()
    assert len(whole["rows"]["imu"]) == 2
    assert whole["rows"]["load"][-1][0] < 6.0
    assert "495.0 s ago" in whole["state"]["text"]


def test_the_load_of_a_stretch_is_that_of_its_frames():
    fed = Fed()
    bits = {0: 0, 1: 0}
    for k in range(15):
        t = 0.005 + 0.01 * k
        seen = fed.seen.see(t, frame("Imu"))
        bits[int(t / LOAD_WINDOW)] += seen.bits
        fed.stream.add([seen], t)
    assert "load" not in fed.news()["rows"]
    fed.stream.add([], 0.5)
    shares = [bits[0] / 50_000, bits[1] / 50_000, 0.0, 0.0]
    assert [row[1] for row in fed.news()["rows"]["load"]] == pytest.approx(shares, abs=1e-4)
    assert 0.01 < shares[1] < shares[0] < 0.04


def test_changes_of_mode_and_fault_codes_are_events():
    events = Fed().feed(
        (0.0, "RollControlStatus", {"Mode": 0}),
        (0.1, "RollControlStatus", {"Mode": 1}),
        (0.15, "RollControlDiagnostics", latched(1 << 16)),
        (0.2, "RollControlDiagnostics", active(0)),
        (0.3, "RollControlDiagnostics", active(1)),
        (0.35, "RollControlDiagnostics", latched(1 << 16 | 1 << 9 | 1 << 8 | 1)),
        (0.4, "RollControlStatus", {"Mode": 3}),
        (0.5, "RollControlDiagnostics", active(1 << 9)),
    ).news()["events"]  # fmt: skip
    assert events == [
        [0.0, "controller heard"],
        [0.0, "INIT"],
        [0.1, "INIT → ACTIVE"],
        [0.2, "fault code 16 (tick missed) has occurred before"],
        [0.3, "fault code 0 (Imu late) active"],
        [0.4, "ACTIVE → SAFE"],
        [0.5, "fault code 0 (Imu late) no longer active"],
        [0.5, "fault code 8 (stuck) came and went"],
        [0.5, "fault code 9 (reference) active"],
    ]


def test_who_falls_silent_and_comes_back_is_an_event_however_often_one_looks():
    """In one look over all of it, and with a look during the silence."""
    expected = [
        [0.0, "vehicle heard"],
        [0.0, "vehicle silent from now on"],
        [3.0, "vehicle heard again after 3.0 s"],
    ]
    at_once = Fed().feed((0.0, "Imu", {}), (3.0, "Imu", {}))
    assert at_once.news()["events"] == expected
    often = Fed().feed((0.0, "Imu", {}), now=0.1).feed(now=1.0).feed((3.0, "Imu", {}))
    assert often.news()["events"] == expected


def test_how_things_are_in_words():
    fed = Fed()
    assert state(fed.seen)[:2] == ("none", "The bus is silent")
    fed.feed((0.0, "Imu", {}))
    assert state(fed.seen)[:2] == ("bad", "No controller on the bus")
    fed.feed((0.1, "RollControlStatus", {}))
    assert state(fed.seen)[:2] == ("good", "Live")
    fed.feed((1.0, "Imu", {}))
    assert state(fed.seen) == (
        "bad", "The controller is silent", "Its last frame came 0.9 s ago."
    )  # fmt: skip
    fed.feed(now=4.0)
    kind, headline, text = state(fed.seen)
    assert (kind, headline) == ("bad", "The bus is silent")
    assert "3.0 s ago" in text
    assert state(fed.seen, lost=True)[1] == "The bus is gone"
    assert json.loads(fed.stream.news(lost=True))["state"]["headline"] == "The bus is gone"


def test_values_and_rates_go_along():
    fed = Fed().feed(*((0.01 * k, "Imu", {"Counter": k % 15}) for k in range(101)))
    message = fed.news()
    assert message["now"] == 1.0
    assert message["values"] == fed.seen.summary()
    assert message["rates"]["Imu"] == pytest.approx(101.0)
