"""A bench for the ECU: calibrations from physical numbers, frames by cantools and autosar-e2e, a
small plant integrated exactly. It shares no arithmetic with the firmware.
"""

import zlib
from collections import deque
from dataclasses import dataclass, field
from functools import cache

import numpy as np
import pytest
from e2e import p01
from scipy.linalg import expm, solve_discrete_are

from canroll import dbc
from canroll.firmware import calibration as fw
from canroll.firmware import ecu as loop
from canroll.firmware.calibration import Calibration
from canroll.firmware.com import signals
from canroll.firmware.state import Ecu
from canroll.firmware.subset import fields

G = 9.81
DATABASE = dbc.load()
DATA_IDS = {message.name: dbc.data_id(message) for message in DATABASE.messages}
ECU_FIELDS = [field.name for field in fields(Ecu)]
STATE_Q = np.array([30, 27, 24, 24, 27])
MEASURED_Q = np.array([27, 24, 30])


@dataclass(frozen=True, slots=True)
class Vehicle:
    """One degree of freedom: I_x φ'' + C φ' + (K − m g h) φ = m h a_y + M, SI units."""

    inertia: float
    damping: float
    roll_stiffness: float
    mass: float
    arm: float
    half_track: float = 0.819

    @property
    def stiffness(self) -> float:
        return self.roll_stiffness - self.mass * G * self.arm

    @property
    def moment_per_acceleration(self) -> float:
        return self.mass * self.arm

    def a(self) -> np.ndarray:
        return np.array(
            [[0.0, 1.0], [-self.stiffness / self.inertia, -self.damping / self.inertia]]
        )


VAN = Vehicle(500.0, 3538.08, 18438.02, 1700.0, 0.35)
SUV = Vehicle(442.0, 7600.0, 64800.0, 984.0, 0.45, 0.72)


def hold(a: np.ndarray, b: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Discretise x' = A x + B u for u held over ``step``."""
    n, m = b.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = a, b
    exponential = expm(block * step)
    return exponential[:n, :n], exponential[:n, n:]


def quantise_row(values, result_q: int, factor_q) -> tuple[list[int], int]:
    """Integers and shift of one coefficient row, as fine as its largest coefficient allows."""
    scaled = np.asarray(values, float) * 2.0 ** (result_q - np.asarray(factor_q, float))
    largest = np.max(np.abs(scaled))
    shift = 30 if largest == 0 else int(np.clip(np.floor(29 - np.log2(largest)), 1, 62))
    row = [round(value) for value in scaled * 2.0**shift]
    assert max(abs(value) for value in row) <= fw.COEFFICIENT, (values, shift)
    return row, shift


@dataclass(frozen=True, slots=True)
class Model:
    """The observer's model and its steady Kalman gains, in float64."""

    phi: np.ndarray
    gamma: np.ndarray
    gamma_steering: np.ndarray
    output: np.ndarray
    noise: np.ndarray
    measurement_noise: np.ndarray
    sequential: np.ndarray
    single: np.ndarray


@cache
def observer_model(vehicle: Vehicle, tick: float, sensor_period: float | None = None) -> Model:
    """States roll, roll rate, a_y, a_y rate (a damped second-order model), gyro bias."""
    a = np.zeros((5, 5))
    a[:2, :2] = vehicle.a()
    a[1, 2] = vehicle.moment_per_acceleration / vehicle.inertia
    omega, zeta = 1.5, 0.8
    a[2, 3], a[3, 2], a[3, 3] = 1.0, -(omega**2), -2 * zeta * omega
    a[4, 4] = -0.02
    b = np.zeros((5, 2))
    b[1, 0] = 1 / vehicle.inertia
    b[3, 1] = omega**2
    phi, gamma = hold(a, b, tick)
    output = np.array([[0, 1, 0, 0, 1], [G, 0, 1, 0, 0], [1, 0, 0, 0, 0]], float)
    noise = np.diag([1e-10, 4e-6, 1e-3, 0.4, 1e-9]) * tick / 0.01
    measurement_noise = np.array([0.003**2, 0.05**2])
    return Model(
        phi,
        gamma[:, 0],
        gamma[:, 1],
        output,
        noise,
        measurement_noise,
        sequential_gains(phi, output[:2], noise, measurement_noise),
        sequential_gains(phi, output[:1], noise, measurement_noise[:1])[0],
    )


def sequential_gains(phi, output, noise, measurement_noise) -> np.ndarray:
    """Gains of scalar updates, one after the other, that together are the steady Kalman filter."""
    p = solve_discrete_are(phi.T, output.T, noise, np.diag(measurement_noise))
    gains = []
    for c, r in zip(output, measurement_noise, strict=True):
        gain = p @ c / (c @ p @ c + r)
        p = p - np.outer(gain, c @ p)
        gains.append(gain)
    return np.array(gains)


FEEDBACK = np.array([3000.0, 2400.0, 0.0, 0.0, 0.0])
FEEDFORWARD = np.array([0.0, 0.0, 300.0, 20.0, 0.0])


def taylor_units(vehicle: Vehicle, tick: float) -> list[list[float]]:
    """What the dimensionless entries of the identified model are multiplied by, row by row."""
    accelerated = vehicle.moment_per_acceleration / vehicle.inertia
    return [
        [1.0, tick, accelerated * tick**2, tick**2 / vehicle.inertia],
        [1 / tick, 1.0, accelerated * tick, tick / vehicle.inertia],
    ]


def fill_observer(cal: Calibration, model: Model, units=((), ())) -> None:
    for i in range(5):
        scale = units[i] if i < 2 else []
        row, cal.phi_shift[i] = quantise_row(
            [*model.phi[i], model.gamma[i], model.gamma_steering[i], *scale],
            STATE_Q[i],
            [*STATE_Q, fw.Q_MOMENT, fw.Q_ACCELERATION, 30, 27, 24, 14][: 7 + len(scale)],
        )
        cal.phi[i], cal.gamma[i], cal.gamma_steering[i] = row[:5], row[5], row[6]
        if len(scale):
            cal.model_scale[i] = row[7:]
    for m in range(3):
        row, cal.output_shift[m] = quantise_row(
            [*model.output[m], 0.0], MEASURED_Q[m], [*STATE_Q, fw.Q_MOMENT]
        )
        cal.output[m], cal.output_moment[m] = row[:5], row[5]
    for m, gains in enumerate(model.sequential):
        for i in range(5):
            (cal.correction[m][i],), cal.correction_shift[m][i] = quantise_row(
                [gains[i]], STATE_Q[i], [MEASURED_Q[m]]
            )
    for i in range(5):
        (cal.correction_single[i],), cal.correction_single_shift[i] = quantise_row(
            [model.single[i]], STATE_Q[i], [MEASURED_Q[0]]
        )


COVARIANCE_SCALE = np.array([0.02, 0.05, 1.0, 2.0, 0.01])
"""Power-of-two units of the covariance's states are the next powers of two of these."""


def covariance_units() -> np.ndarray:
    return 2.0 ** np.round(np.log2(COVARIANCE_SCALE))


def measurement_units() -> np.ndarray:
    return 2.0 ** np.round(np.log2([0.05, 1.0]))


def fill_covariance(cal: Calibration, model: Model, cap: float = 30.0) -> None:
    s, m = covariance_units(), measurement_units()
    cal.covariance_phi = np.round(model.phi * s[None, :] / s[:, None] * 2**24).astype(int).tolist()
    cal.covariance_output = (
        np.round(model.output[:2] * s[None, :] / m[:, None] * 2**24).astype(int).tolist()
    )
    cal.process_noise = [round(v) for v in np.diag(model.noise) / s**2 * 2**24]
    cal.measurement_noise = [round(v) for v in model.measurement_noise / m**2 * 2**24]
    cal.covariance_start = [1 << 24] * 5
    cal.covariance_max = [round(cap * 2**24)] * 5
    for k in range(2):
        for i in range(5):
            # x += gain 2**-24 s_i/m_k innovation, each in its own Q
            power = np.log2(s[i] / m[k]) + STATE_Q[i] - MEASURED_Q[k] - 24
            cal.covariance_gain_shift[k][i] = round(-power)


def fill_identification(cal: Calibration, vehicle: Vehicle, tick: float) -> None:
    cal.rls_decimation = max(1, round(0.01 / tick))
    step = cal.rls_decimation * tick
    unit = 100.0
    cal.rls_forgetting = round(0.998 * 2**30)
    cal.rls_washout = round(np.exp(-step / 1.0) * 2**30)
    cal.rls_gate = round(0.045 * 2**27)
    cal.rls_trace_max = 20 << 20
    cal.rls_start = 8 << 20
    cal.rls_lo = [round(0.5 * 2**28), round(0.4 * 2**28)]
    cal.rls_hi = [round(1.6 * 2**28), round(2.0 * 2**28)]
    cal.rls_moment = round(step / unit * 2.0 ** (20 - 14 + 30))
    cal.rls_lateral = round(vehicle.moment_per_acceleration * step / unit * 2.0 ** (20 - 24 + 30))
    cal.rls_inertia = round(vehicle.inertia / unit * 2.0 ** (20 - 27 + 30))
    cal.rls_stiffness = round(vehicle.stiffness * step / unit * 2.0 ** (20 - 30 + 30))
    cal.rls_damping = round(vehicle.damping / (vehicle.stiffness * step) * 2**20)
    cal.model_stiffness = round(vehicle.stiffness * tick**2 / vehicle.inertia * 2**30)
    cal.model_damping = round(vehicle.damping * tick / vehicle.inertia * 2**30)


def calibration(
    vehicle: Vehicle = VAN,
    *,
    tick: float = 0.01,
    feedback=FEEDBACK,
    feedforward=FEEDFORWARD,
    predict_steps: int = 0,
    lag: float = 0.015,
    **overrides,
) -> Calibration:
    """A calibration that runs: state feedback from two sensors, four corners, every frame E2E."""
    cal = Calibration()
    cal.tick_us = round(tick * 1e6)
    cal.observer, cal.measurements, cal.e2e = fw.CONSTANT_GAIN, 3, 1
    per = lambda seconds: round(seconds / tick)  # noqa: E731
    cal.timeout_ticks = [per(0.05), per(0.1), 0, per(0.05), 0]
    cal.e2e_max_delta, cal.e2e_max_repeated, cal.e2e_sync = (
        [3] * fw.N_RX,
        [14] * fw.N_RX,
        [1] * fw.N_RX,
    )
    cal.init_ticks, cal.recovery_ticks, cal.ramp_ticks = per(0.2), per(0.5), per(0.2)
    cal.release_ticks, cal.stuck_ticks = per(0.4), per(0.1)
    cal.roll_rate_max, cal.acceleration_max = round(2.5 * 2**27), round(20.0 * 2**24)
    model = observer_model(vehicle, tick)
    cal.phi_shift, cal.output_shift = [1] * 5, [1] * 3
    identified = overrides.get("identification") == 1
    fill_observer(cal, model, taylor_units(vehicle, tick) if identified else ((), ()))
    fill_covariance(cal, model)
    fill_identification(cal, vehicle, tick)
    cal.bias_max = round(0.05 * 2**27)
    cal.predict_steps = predict_steps
    cal.actuator_rate = round((1 - np.exp(-tick / lag)) * 2**30)
    cal.feedback, cal.feedback_shift = quantise_row(feedback, fw.Q_MOMENT, STATE_Q)
    cal.feedforward, cal.feedforward_shift = quantise_row(feedforward, fw.Q_MOMENT, STATE_Q)
    cal.output_gain, cal.output_gain_shift = quantise_row(
        [-2800.0, 0.0, 0.0], fw.Q_MOMENT, MEASURED_Q
    )
    cal.moment_max, cal.slew_max = 4000 << 14, 4000 << 14
    cal.schedule_points = 1
    cal.schedule_gain = [1 << 28] * 8
    cal.schedule_front_share = [round(1.99 / 3.5 * 2**30)] * 8
    cal.fade_low, cal.fade_high = round(5 / 3.6 * 2**20), round(10 / 3.6 * 2**20)
    cal.straight_steering, cal.straight_yaw_rate = round(0.03 * 2**24), round(0.01 * 2**27)
    cal.offset_gain, cal.offset_shift = 1, 8
    cal.offset_rate_max, cal.offset_acceleration_max = round(0.035 * 2**27), round(0.5 * 2**24)
    cal.heartbeat_ticks, cal.status_ticks = per(0.05), per(0.1)
    # there and back, as a design has it
    cal.acknowledge_ticks = max(3, 2 * predict_steps + 2)
    cal.delivery_window, cal.delivery_samples, cal.response_ticks = 8, 4, 20
    cal.apart_samples, cal.bound_samples = 8, 10
    cal.redundancy_pass = [2**19, 2**23, 2**27, 2**26]
    cal.erratic_kept, cal.response_mean = [7 * 2**27] * 5, 2**20
    # as wide as it gets: tests of the law are not those of the envelope or of the speed
    cal.speed_noise, cal.acceleration_noise = 200 << 20, fw.STATE_MAX
    cal.envelope_moment = cal.envelope_slew = cal.envelope_outward = fw.STATE_MAX
    cal.envelope_age, cal.envelope_ticks = 1 << 20, 1 << 20
    cal.arm_front = cal.arm_rear = round(2**28 / (2 * vehicle.half_track))
    cal.track_front = cal.track_rear = round(2**28 * 2 * vehicle.half_track)
    cal.force_max = [4000 << 14] * 4
    cal.share_slack = round(0.1 * 2**30)
    cal.bar_max = [2000 << 14] * 2
    cal.damper_speed = [round(0.3 * 2**27), round(0.15 * 2**27)]
    cal.damper_force = [1200 << 14, 3300 << 14]
    cal.damper_slope = [800 << 14, 2700 << 14]
    cal.current_max = 1600 << 14
    for name, value in overrides.items():
        assert hasattr(cal, name), name
        setattr(cal, name, value)
    return cal


def sealed(cal: Calibration) -> Calibration:
    """``cal`` with the CRC of its bytes, as the compilers for the targets lay them out."""
    cal.crc = 0
    types = {"i32": "<i4", "u8": "u1"}
    rows = [(f.name, types[f.kind], f.shape) for f in fields(Calibration)]
    packed = np.zeros((), np.dtype(rows, align=True))
    for name in packed.dtype.names:
        packed[name] = getattr(cal, name)
    checksum = zlib.crc32(packed.tobytes()[: packed.dtype.fields["crc"][1]])
    cal.crc = int(np.uint32(checksum).astype(np.int32))
    return cal


def started(cal: Calibration) -> Ecu:
    """An ECU that has accepted ``cal``."""
    ecu = Ecu()
    refused = loop.init(ecu, sealed(cal))
    assert refused == 0, refused
    return ecu


class Sender:
    """Frames as the plant's nodes send them: packed by cantools, protected by autosar-e2e."""

    def __init__(self) -> None:
        self.counter: dict[str, int] = {}
        self.sample: dict[str, int] = {}

    def frame(self, name: str, *, new_sample: bool = True, **values) -> bytearray:
        message = DATABASE.get_message_by_name(name)
        self.counter[name] = (self.counter.get(name, -1) + 1) % 15
        if new_sample:
            self.sample[name] = (self.sample.get(name, -1) + 1) % 16
        data = bytearray(
            message.encode(
                {
                    "Checksum": 0,
                    "Counter": self.counter[name],
                    "SampleCounter": self.sample.get(name, 0),
                    **values,
                },
                strict=False,
            )
        )
        p01.e2e_p01_protect(data, DATA_IDS[name], increment_counter=False)
        return data


def deliver(ecu: Ecu, name: str, data) -> None:
    ident = DATABASE.get_message_by_name(name).frame_id
    loop.receive(ecu, signals.RX_IDS.index(ident), list(data), len(data))


def decoded(slot: int, payload) -> dict:
    """A frame of the ECU as cantools reads it, numbers for choices."""
    message = DATABASE.get_message_by_frame_id(signals.TX_IDS[slot])
    return message.decode(bytes(payload), decode_choices=False)


def sent_frames(ecu: Ecu) -> dict[int, dict]:
    """Take what the tick wants sent, checked by autosar-e2e."""
    frames = {}
    for slot in range(6):
        if ecu.tx_pending[slot]:
            ecu.tx_pending[slot] = 0
            data = bytearray(ecu.tx_payload[slot])
            message = DATABASE.get_message_by_frame_id(signals.TX_IDS[slot])
            assert p01.e2e_p01_check(data, DATA_IDS[message.name])
            frames[slot] = decoded(slot, data)
    return frames


ACTUATOR_OK = {
    "DeliveredMomentFront": 0.0,
    "DeliveredMomentRear": 0.0,
    "StatusFrontLeft": 0,
    "StatusFrontRight": 0,
    "StatusRearLeft": 0,
    "StatusRearRight": 0,
    "Enabled": 1,
    "CommandHeld": 1,
    "AcceptedCounter": 0,
}
FORCES = ("ForceFrontLeft", "ForceFrontRight", "ForceRearLeft", "ForceRearRight")


@cache
def plant(vehicle: Vehicle, lag: float) -> tuple[np.ndarray, np.ndarray]:
    """Roll, roll rate and delivered moment over a millisecond under held a_y and command."""
    a, b = np.zeros((3, 3)), np.zeros((3, 2))
    a[:2, :2] = vehicle.a()
    a[1, 2], a[2, 2] = 1 / vehicle.inertia, -1 / lag
    b[1, 0], b[2, 1] = vehicle.moment_per_acceleration / vehicle.inertia, 1 / lag
    return hold(a, b, 0.001)


@dataclass
class Bench:
    """An ECU in closed loop with one roll degree of freedom behind a lagging actuator.

    ``delay`` ticks lie between the tick that sends a command and the actuator. ``drop`` names
    messages that are lost, ``change`` signals that are falsified; both may be altered at any time.
    """

    cal: Calibration
    vehicle: Vehicle = VAN
    delay: int = 0
    lag: float = 0.015
    noise: tuple[float, float] = (0.0, 0.0)
    bias: tuple[float, float] = (0.0, 0.0)
    speed_kmh: float = 90.0
    steering_deg: float = 0.0
    yaw_rate_deg: float = 0.0
    seed: int = 0
    drop: set[str] = field(default_factory=set)
    lose_commands: bool = False
    frozen: set[str] = field(default_factory=set)
    change: dict[str, dict] = field(default_factory=dict)
    spoil: set[str] = field(default_factory=set)
    reference: bool = False

    def __post_init__(self) -> None:
        self.ecu = started(self.cal)
        self.sender = Sender()
        self.random = np.random.default_rng(self.seed)
        self.tick = self.cal.tick_us * 1e-6
        self.phi, self.gamma = plant(self.vehicle, self.lag)
        self.x = np.zeros(3)
        self.pipe: deque = deque()
        self.accepted, self.command, self.held = 15, 0.0, 0
        self.front_part = 0.5
        self.k = 0
        self.frames: dict[int, dict] = {}
        self.raw: dict[str, bytes] = {}
        self.commands = 0

    @property
    def received(self) -> dict[str, dict]:
        """The frames of this tick, as cantools reads them."""
        return {
            name: DATABASE.decode_message(name, data, decode_choices=False)
            for name, data in self.raw.items()
        }

    @property
    def t(self) -> float:
        return self.k * self.tick

    def inputs(self, ay: float) -> dict[str, dict]:
        """Physical values of every frame due at this tick, faults included."""
        rate = self.x[1] + self.bias[0] + self.random.normal() * self.noise[0]
        lateral = ay + G * self.x[0] + self.bias[1] + self.random.normal() * self.noise[1]
        period = lambda seconds: self.k % max(1, round(seconds / self.tick)) == 0  # noqa: E731
        due = {}
        if period(0.01):
            due["Imu"] = {
                "RollRate": np.degrees(rate),
                "LateralAcceleration": lateral,
                "YawRate": self.yaw_rate_deg,
            }
            due["ActuatorState"] = ACTUATOR_OK | {
                "DeliveredMomentFront": self.x[2] * self.front_part,
                "DeliveredMomentRear": self.x[2] * (1 - self.front_part),
                "AcceptedCounter": self.accepted,
                "CommandHeld": self.held,
            }
            if self.reference:
                due["RollReference"] = {
                    "RollAngle": np.degrees(self.x[0]),
                    "RollRate": np.degrees(self.x[1]),
                    "LateralAcceleration": ay,
                }
        if period(0.02):
            due["VehicleMotion"] = {
                "VehicleSpeed": self.speed_kmh,
                "SteeringWheelAngle": self.steering_deg,
                "LongitudinalAcceleration": 0.0,
            }
        for name, values in self.change.items():
            if name in due:
                due[name] = due[name] | values
        return due

    def step(self, ay=0.0, elapsed: int = 1) -> Ecu:
        """Send the frames that are due, run one tick, move the plant on.

        ``ay`` is a number, or a function of time for an input that doesn't wait for ticks.
        """
        input_at = ay if callable(ay) else lambda t: ay
        due = self.inputs(input_at(self.t))
        self.raw = {}
        for name, values in due.items():
            data = self.sender.frame(name, new_sample=name not in self.frozen, **values)
            self.raw[name] = bytes(data)
            if name in self.spoil:
                data[3] ^= 16
            if name not in self.drop:
                deliver(self.ecu, name, data)
        loop.tick(self.ecu, self.cal, elapsed)
        self.frames = sent_frames(self.ecu)
        command = self.frames.get(0)
        if command is not None:
            self.commands += 1
        self.pipe.append(None if self.lose_commands else command)
        arrived = self.pipe.popleft() if len(self.pipe) > self.delay else None
        if arrived is not None:
            forces = np.array([arrived[name] for name in FORCES])
            moments = forces * np.array([1, -1, 1, -1]) * self.vehicle.half_track
            self.command, self.accepted, self.held = moments.sum(), arrived["Counter"], 1
            if self.command:
                self.front_part = float(np.clip(moments[:2].sum() / self.command, 0.0, 1.0))
        for step in range(round(elapsed * self.tick / 0.001)):
            now = input_at(self.t + (step + 0.5) * 0.001)
            self.x = self.phi @ self.x + self.gamma @ np.array([now, self.command])
        self.k += elapsed
        return self.ecu

    def run(self, seconds: float, ay=lambda t: 0.0) -> "Bench":
        for _ in range(round(seconds / self.tick)):
            self.step(ay)
        return self

    def active(self) -> "Bench":
        """Run straight ahead until the law is on with all its authority."""
        return self.run(0.6)


def lane_change(t: float, amplitude: float = 4.0, period: float = 2.5) -> float:
    """One period of a sine, then straight ahead, every six seconds."""
    phase = t % 6.0
    return amplitude * np.sin(2 * np.pi * phase / period) if phase < period else 0.0


def accused_axles(ecu: Ecu) -> list[int]:
    """Return 1 for each axle that is not believed, front and rear."""
    return [ecu.contradicted >> 3 & 1, ecu.contradicted >> 4]


def bad_samples(ecu, balance, ticks, judge, samples) -> int:
    """Return after how many bad ones ``judge`` believed no axle: they count up to ``ticks``."""
    bad = 0
    for sample in samples:
        before = abs(ecu.evidence[balance])
        judge(sample)
        count = abs(ecu.evidence[balance])
        assert count in (0, min(before + 1, ticks), min(before + 2, ticks))
        assert accused_axles(ecu) == [int(count == ticks)] * 2
        bad = bad + 1 if count else 0
        if accused_axles(ecu) == [1, 1]:
            return bad
    pytest.fail("every axle is believed")
