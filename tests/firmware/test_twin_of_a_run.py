"""The moment of complete runs, bus and sensors and all, against the loop in float64."""

import numpy as np
import pytest
import rig
from twin import Twin

from canroll.firmware import calibration as fw
from canroll.firmware import ecu as loop
from canroll.firmware.com import signals
from canroll.firmware.state import ACTIVE, RX_IMU, Ecu
from canroll.runs import experiment
from canroll.runs.trace import TICK
from canroll.runs.virtual_time import closed_loop
from canroll.setup import controller as hil_controller


class Watched:
    """The ECU in CPython with its float64 twin beside it, fed with the same frames."""

    def __init__(self, cal, design) -> None:
        self.cal, self.ecu = cal, rig.started(cal)
        controller = design.controller
        model = controller.observer.model
        gains = np.zeros((2, 5))
        for row in controller.observer.measurements:
            gains[row] = controller.observer.correction[row]
        if controller.output_gain is not None:
            output_gain = np.asarray(controller.output_gain)
            law = lambda ahead, rate, lateral: output_gain @ [rate, lateral, ahead[0]]  # noqa: E731
        else:
            gain = controller.feedback + controller.feedforward
            law = lambda ahead, rate, lateral: -gain @ ahead  # noqa: E731
        self.twin = Twin(
            model.phi,
            model.gamma[:, 0],
            model.gamma_steering[:, 0],
            model.output[:2],
            gains,
            law,
            predict_steps=controller.predict_steps,
            actuator_rate=controller.actuator_rate,
            moment_max=cal.moment_max / 2**14,
            slew_max=cal.slew_max / 2**14,
            bias_max=cal.bias_max / 2**27,
        )
        self.frames: dict[str, dict] = {}
        self.speed = self.wheel = 0.0
        self.differences: list[float] = []
        self.moments: list[float] = []

    @property
    def state(self) -> Ecu:
        return self.ecu

    def image(self) -> bytes:
        return b""

    def receive(self, ident, payload, length) -> None:
        if ident in signals.RX_IDS:
            message = rig.DATABASE.get_message_by_frame_id(ident)
            data = bytes(payload[:length])
            self.frames[message.name] = message.decode(data, decode_choices=False)
            loop.receive(self.ecu, signals.RX_IDS.index(ident), [int(b) for b in payload], length)

    def schedule(self, values, q: int) -> float:
        points = self.cal.schedule_points
        grid = np.array(self.cal.schedule_speed[:points]) / 2**20
        return float(np.interp(self.speed, grid, np.array(values[:points]) / 2.0**q))

    def tick(self, elapsed: int) -> list[tuple[int, bytes]]:
        loop.tick(self.ecu, self.cal, elapsed)
        ecu, twin = self.ecu, self.twin
        # whether a frame was accepted is E2E's decision, what is in it is not
        accepted = {
            name: values
            for name, values in self.frames.items()
            if ecu.age[signals.RX_IDS.index(rig.DATABASE.get_message_by_name(name).frame_id)] == 0
        }
        if not ecu.fresh[RX_IMU]:
            accepted.pop("Imu", None)
        self.frames = {}
        motion = accepted.get("VehicleMotion")
        if motion is not None:
            self.speed = motion["VehicleSpeed"] / 3.6
            self.wheel = np.radians(motion["SteeringWheelAngle"])
        twin.steering = self.schedule(self.cal.schedule_steering, 20) * self.wheel
        if ecu.motion_lost:
            twin.steering = twin.x[2]
        low, high = self.cal.fade_low / 2**20, self.cal.fade_high / 2**20
        fade = np.clip((self.speed - low) / (high - low), 0.0, 1.0)
        moment = twin.tick(
            accepted,
            authority=ecu.authority / 2**30,
            gain=self.schedule(self.cal.schedule_gain, 28) * fade,
            active=ecu.mode == ACTIVE,
        )
        twin.sent(ecu.triggered > 0)
        self.moments.append(moment)
        self.differences.append(abs(moment - ecu.moment / 2**14))
        out = []
        for slot in range(6):
            if ecu.tx_pending[slot]:
                ecu.tx_pending[slot] = 0
                out.append((signals.TX_IDS[slot], bytes(ecu.tx_payload[slot])))
        return out


def watched_run(monkeypatch, scenario: str, **options) -> Watched:
    designs = []
    calibrated = hil_controller.calibrated

    def noting(*task):
        designs.append(calibrated(*task))
        return designs[-1]

    monkeypatch.setattr(hil_controller, "calibrated", noting)
    settings, controller = experiment.plan(scenario, backend="python", **options)
    watched = Watched(controller.record, designs[-1][0])
    monkeypatch.setattr(
        "canroll.runs.virtual_time.tick_rows",
        lambda times, images, record: np.zeros(len(images), TICK),
    )
    closed_loop(
        experiment.build_world(settings, enabled=True),
        watched,
        tick_ns=round(settings.tick * 1e9),
        duration_ns=12_000_000_000,
    )
    assert watched.ecu.mode == ACTIVE
    assert watched.ecu.fault_latched == 0
    assert watched.cal.law in (fw.STATE_FEEDBACK, fw.OUTPUT_FEEDBACK)
    return watched


RUNS = [
    {"law": "lqr", "vehicle": "van_2021"},
    {"law": "hinf_delay", "vehicle": "van_2021", "gains": "theorem", "unverified": True},
]
ALL_RUNS = [
    {"law": "ay_feedforward", "vehicle": "van_real"},
    {"law": "ay_feedforward", "vehicle": "van_real", "bus": "gateway_20ms", "trigger": "every"},
    {"law": "lqr", "vehicle": "van_2021", "tick_ms": 5.0, "observer": "steering"},
    {"law": "lqr", "vehicle": "suv_2020", "bus": "125k_busy"},
]


def name_of(options) -> str:
    return "-".join(str(value) for value in options.values())


@pytest.mark.parametrize("options", RUNS, ids=name_of)
def test_a_double_lane_change_within_one_newton_metre(monkeypatch, options):
    watched = watched_run(monkeypatch, "double_lane_change", **options)
    assert max(watched.moments) > 300.0
    assert max(watched.differences) < 1.0


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["double_lane_change", "roundabout"])
@pytest.mark.parametrize("options", ALL_RUNS, ids=name_of)
def test_every_kind_of_run_within_one_newton_metre(monkeypatch, scenario, options):
    watched = watched_run(monkeypatch, scenario, **options)
    assert max(np.abs(watched.moments)) > 200.0
    assert max(watched.differences) < 1.0
