"""Sensor channels: low-pass, noise, bias, range, faults and sampling instants."""

import dataclasses
import math

import numpy as np
import pytest
from scipy import signal as sps

from canroll import dbc, vehicles
from canroll.errors import CanrollError, UnknownNameError
from canroll.plant_sim.bodies import ports
from canroll.plant_sim.kernels.instants import NEVER
from canroll.plant_sim.kernels.schedule import ScheduledFault
from canroll.plant_sim.nodes import codec, codec_tables, sensor_kernel
from canroll.plant_sim.nodes import sensors as sensor_setup
from canroll.plant_sim.nodes.sensors import SensorOptions

VEHICLE = vehicles.load("van_real")
STEP_NS = 1_000_000
IMU = sensor_setup.NODES.index("Imu")
LEVEL = dataclasses.replace(
    VEHICLE,
    sensors=dataclasses.replace(
        VEHICLE.sensors, imu_position=(0.0, 0.0, 0.0), imu_misalignment=(0.0, 0.0, 0.0)
    ),
)


def make(vehicle=LEVEL, seed=3, **options):
    return sensor_setup.build(vehicle, options=SensorOptions(**options), seed=seed)


def ideal(*faults, vehicle=LEVEL, **options):
    return sensor_setup.build(
        vehicle, options=SensorOptions.ideal(faults=faults, **options), seed=3
    )


def observe(nodes, **outputs):
    vector = np.zeros(ports.N_OUTPUTS)
    for name, value in outputs.items():
        vector[getattr(ports, name.upper())] = value
    # the body's CG accelerates as the car's
    vector[ports.BODY_ACC : ports.BODY_ACC + 2] = vector[ports.AX : ports.AY + 1]
    sensor_kernel.observe(nodes, np.zeros(ports.N_INPUTS), vector)


def read(nodes, t_ns, node=IMU, now_ns=None):
    message = dbc.load().get_message_by_name(sensor_setup.NODES[node])
    frame = sent(nodes, node, t_ns, now_ns or t_ns, 3)
    return message.decode(frame, decode_choices=False)


def sent(nodes, node, t_ns, now_ns, seed):
    """Return the frame of a sample."""
    payload = np.zeros(codec.MAX_PAYLOAD, np.uint8)
    sensor_kernel.sample(nodes, codec_tables.load(), node, t_ns, now_ns, seed, payload)
    sensor_kernel.finish(nodes, codec_tables.load(), node, payload)
    return payload[:8].tobytes()


def test_ideal_sensors_put_the_truth_on_the_bus():
    nodes = ideal()
    observe(nodes, roll_rate=0.5, ay=-3.0, yaw_rate=0.2)
    values = read(nodes, STEP_NS)
    assert values["RollRate"] == pytest.approx(math.degrees(0.5), abs=0.0026)
    assert values["LateralAcceleration"] == pytest.approx(-3.0, abs=0.00063)
    assert values["YawRate"] == pytest.approx(math.degrees(0.2), abs=0.0026)


@pytest.mark.parametrize("name", ["SuspensionRate", "SuspensionTravel"])
def test_strokes_come_out_in_millimetres_wheel_by_wheel(name):
    nodes = ideal()
    vector = np.zeros(ports.N_OUTPUTS)
    vector[ports.TRAVEL : ports.TRAVEL + 4] = [0.01, -0.02, 0.03, -0.04]
    vector[ports.TRAVEL_RATE : ports.TRAVEL_RATE + 4] = [0.1, -0.2, 0.3, -0.4]
    sensor_kernel.observe(nodes, np.zeros(ports.N_INPUTS), vector)
    values = list(read(nodes, STEP_NS, sensor_setup.NODES.index(name)).values())[2:6]
    scale = 100 if name == "SuspensionRate" else 10
    assert values == pytest.approx([scale, -2 * scale, 3 * scale, -4 * scale])


def test_chassis_sends_speed_steering_wheel_and_longitudinal_acceleration():
    nodes = ideal()
    inputs, outputs = np.zeros(ports.N_INPUTS), np.zeros(ports.N_OUTPUTS)
    inputs[ports.STEER], outputs[ports.VX], outputs[ports.BODY_ACC] = 0.05, 25.0, 1.5
    sensor_kernel.observe(nodes, inputs, outputs)
    values = read(nodes, STEP_NS, sensor_setup.NODES.index("VehicleMotion"))
    assert values["VehicleSpeed"] == pytest.approx(90.0)
    ratio = VEHICLE.steering.ratio
    assert values["SteeringWheelAngle"] == pytest.approx(math.degrees(0.05 * ratio), abs=0.051)
    assert values["LongitudinalAcceleration"] == pytest.approx(1.5, abs=0.00063)


def test_counters_advance_with_every_sample():
    nodes = ideal()
    seen = [read(nodes, k * STEP_NS) for k in range(40)]
    assert [v["SampleCounter"] for v in seen] == [k % 16 for k in range(40)]
    assert [v["Counter"] for v in seen] == [k % 15 for k in range(40)]


def test_a_sample_between_two_steps_is_interpolated():
    nodes = ideal()
    observe(nodes, roll_rate=0.0)
    observe(nodes, roll_rate=0.4)
    values = read(nodes, 1_250_000, now_ns=2_000_000)
    assert values["RollRate"] == pytest.approx(math.degrees(0.1), abs=0.0026)


def test_low_pass_is_that_of_scipy():
    nodes = make(noise=0.0, bias=0.0)
    bandwidth = VEHICLE.sensors.roll_rate.bandwidth
    t = np.arange(400) * 1e-3
    truth = 0.5 * np.sin(2 * np.pi * 7 * t)
    rate = 2 * np.pi * bandwidth
    _, expected, _ = sps.lsim(([rate], [1.0, rate]), truth, t)
    filtered = []
    for value in truth:
        observe(nodes, roll_rate=value)
        filtered.append(nodes.channel[sensor_kernel.ROLL_RATE]["filtered"])
    np.testing.assert_allclose(filtered, expected, atol=1e-12)


def test_noise_ends_when_it_is_asked_to():
    endless, ending = make(bias=0.0), make(bias=0.0, noise_end=0.050)
    until_100_ms = [
        [
            sensor_kernel.measure(nodes, sensor_kernel.LATERAL, 0.0, k * STEP_NS, k, 5)
            for k in range(100)
        ]
        for nodes in (endless, ending)
    ]
    assert until_100_ms[1][:50] == until_100_ms[0][:50]
    assert not any(until_100_ms[1][50:])


def test_noise_has_the_stated_density_and_is_white_below_the_low_pass():
    nodes = make(bias=0.0)
    data = VEHICLE.sensors.lateral_acceleration
    samples = np.array(
        [
            sensor_kernel.measure(nodes, sensor_kernel.LATERAL, 0.0, k, k, 5)
            for k in range(40_000)
        ]
    )  # fmt: skip
    deviation = data.noise_density * math.sqrt(math.pi / 2 * data.bandwidth)
    assert samples.std() == pytest.approx(deviation, rel=0.02)
    assert abs(samples.mean()) < 4 * deviation / 200
    neighbours = np.corrcoef(samples[:-1], samples[1:])[0, 1]
    assert neighbours == pytest.approx(math.exp(-2 * math.pi * data.bandwidth * 0.01), abs=0.02)
    # One-sided density well below the low-pass, were the sensor sampled without end.
    dense = make(bias=0.0)
    row = dense.channel[sensor_kernel.LATERAL]
    row["noise_memory"] = math.exp(-2 * math.pi * data.bandwidth * 1e-3)
    fast = np.array(
        [sensor_kernel.measure(dense, sensor_kernel.LATERAL, 0.0, k, k, 5) for k in range(200_000)]
    )
    frequency, power = sps.welch(fast, 1e3, nperseg=4096)
    low = power[(frequency > 0.5) & (frequency < 5)].mean()
    assert math.sqrt(low) == pytest.approx(data.noise_density, rel=0.05)


def test_bias_is_drawn_within_its_bound_and_grows_with_temperature():
    bound = VEHICLE.sensors.lateral_acceleration.bias
    drawn = [make(seed=s).channel[sensor_kernel.LATERAL]["bias"] for s in range(40)]
    assert max(map(abs, drawn)) <= bound
    assert max(map(abs, drawn)) > 0.8 * bound
    assert min(drawn) < 0 < max(drawn)
    cold = make(temperature=-60.0).channel[sensor_kernel.LATERAL]["bias"]
    assert abs(cold) > abs(make().channel[sensor_kernel.LATERAL]["bias"])


def test_drift_walks_by_the_root_of_time():
    spread = []
    for seed in range(60):
        nodes = make(seed=seed, noise=0.0, bias=1.0, drift=0.5)
        for k in range(100):
            sensor_kernel.measure(nodes, sensor_kernel.ROLL_RATE, 0.0, k, k, seed)
        spread.append(nodes.channel[sensor_kernel.ROLL_RATE]["drift"])
    expected = 0.5 * VEHICLE.sensors.roll_rate.bias * 1.0
    assert np.std(spread) == pytest.approx(expected, rel=0.3)


def test_bias_and_drift_are_in_what_is_sent():
    nodes = ideal()
    observe(nodes, roll_rate=math.radians(10.0))
    nodes.channel[sensor_kernel.ROLL_RATE]["bias"] = math.radians(1.0)
    nodes.channel[sensor_kernel.ROLL_RATE]["drift"] = math.radians(0.5)
    assert read(nodes, STEP_NS)["RollRate"] == pytest.approx(11.5, abs=0.0026)


@pytest.mark.parametrize(("truth", "sent"), [(0.114, 0.1), (0.126, 0.15), (-0.126, -0.15)])
def test_a_coarse_converter_rounds_to_its_own_step(truth, sent):
    nodes = ideal(lsb={"Imu.LateralAcceleration": 0.05})
    observe(nodes, ay=truth)
    assert read(nodes, STEP_NS)["LateralAcceleration"] == pytest.approx(sent, abs=0.00063)


def test_range_clips():
    nodes = ideal()
    observe(nodes, roll_rate=50.0)
    values = read(nodes, STEP_NS)
    limit = min(math.degrees(VEHICLE.sensors.roll_rate.range), 163.825)
    assert values["RollRate"] == pytest.approx(limit, abs=0.0026)


@pytest.mark.parametrize(
    ("kind", "value", "expected"),
    [("stuck", 0.0, 10.0), ("offset", math.radians(2.0), 22.0), ("invalid", 0.0, 163.83)],
)
def test_faults_change_one_signal_while_they_last(kind, value, expected):
    fault = ScheduledFault(where="Imu.RollRate", kind=kind, start=0.01, end=0.02, value=value)
    nodes = ideal(fault)
    observe(nodes, roll_rate=math.radians(10.0), yaw_rate=0.1)
    assert read(nodes, 5_000_000)["RollRate"] == pytest.approx(10.0)
    observe(nodes, roll_rate=math.radians(20.0), yaw_rate=0.1)
    during = read(nodes, 15_000_000)
    assert during["RollRate"] == pytest.approx(expected, abs=0.0026)
    assert during["YawRate"] == pytest.approx(math.degrees(0.1), abs=0.0026)
    assert read(nodes, 20_000_000)["RollRate"] == pytest.approx(20.0)


def series(kind, count=60, rate=lambda k: 10.0, **options):
    """Roll rates (deg/s) of samples every 10 ms, ``rate(k)`` being true; the fault is at 0.2 s."""
    nodes = ideal(ScheduledFault(where="Imu.RollRate", kind=kind, start=0.2, **options))
    found = []
    for k in range(count):
        observe(nodes, roll_rate=math.radians(rate(k)))
        found.append(read(nodes, k * 10_000_000)["RollRate"])
    return np.array(found)


@pytest.mark.parametrize(
    ("kind", "options", "expected"),
    [
        ("offset", {"value": math.radians(4), "ramp": 0.2}, lambda s: 10 + 20 * min(s, 0.2)),
        ("drift", {"value": math.radians(5)}, lambda s: 10 + 5 * s),
        ("scale", {"value": 0.5}, lambda s: 5.0),
        ("reversed", {}, lambda s: -10.0),
        ("reversed", {"ramp": 0.2}, lambda s: 10 - 100 * min(s, 0.2)),
        ("spike", {"value": math.radians(3)}, lambda s: 13.0 if round(100 * s) % 10 == 0 else 10.0),
        (
            "offset",
            {"value": math.radians(4), "every": 0.05, "lasting": 0.02},
            lambda s: 14.0 if round(100 * s) % 5 < 2 else 10.0,
        ),
    ],
)
def test_a_fault_changes_every_sample_as_stated(kind, options, expected):
    found = series(kind, **options)
    assert found[:20] == pytest.approx(10.0, abs=0.0026)
    assert found[20:] == pytest.approx([expected(0.01 * k) for k in range(40)], abs=0.0052)


def test_a_delayed_signal_is_late_by_its_delay():
    found = series("delay", rate=lambda k: 0.5 * k, value=0.07)
    assert found[:20] == pytest.approx(0.5 * np.arange(20), abs=0.0052)
    assert found[20:] == pytest.approx(0.5 * np.arange(13, 53), abs=0.0052)


def test_faults_of_one_signal_add_up():
    nodes = ideal(
        ScheduledFault(where="Imu.RollRate", kind="scale", value=2.0),
        ScheduledFault(where="Imu.RollRate", kind="offset", value=math.radians(1.0)),
    )
    observe(nodes, roll_rate=math.radians(10.0))
    assert read(nodes, 0)["RollRate"] == pytest.approx(21.0, abs=0.0052)


def test_a_frozen_message_repeats_its_sample_and_goes_on_counting():
    nodes = ideal(ScheduledFault(where="Imu", kind="frozen", start=0.02, end=0.04))
    seen = []
    for k in range(6):
        observe(nodes, roll_rate=math.radians(k), yaw_rate=0.01 * k)
        seen.append(read(nodes, k * 10_000_000))
    assert [frame["RollRate"] for frame in seen] == pytest.approx([0, 1, 1, 1, 4, 5], abs=0.0026)
    assert [frame["SampleCounter"] for frame in seen] == [0, 1, 1, 1, 4, 5]
    assert [frame["Counter"] for frame in seen] == [0, 1, 2, 3, 4, 5]


def test_a_frozen_counter_is_repeated_with_fresh_values():
    nodes = ideal(ScheduledFault(where="Imu", kind="frozen_counter", start=0.02, end=0.04))
    seen = []
    for k in range(6):
        observe(nodes, roll_rate=math.radians(k))
        seen.append(read(nodes, k * 10_000_000))
    assert [frame["RollRate"] for frame in seen] == pytest.approx(range(6), abs=0.0026)
    assert [frame["Counter"] for frame in seen] == [0, 1, 1, 1, 4, 5]


def test_a_node_that_was_down_restarts_its_counters():
    nodes = ideal(ScheduledFault(where="Imu", kind="down", start=0.02, end=0.04))
    sent_at = [k for k in range(6) if not sensor_kernel.silent(nodes, IMU, k * 10_000_000)]
    assert sent_at == [0, 1, 4, 5]
    assert nodes.node[IMU]["samples"] == 0


def test_a_clock_that_drifts_stretches_the_cycle():
    nodes = ideal(ScheduledFault(where="Imu", kind="clock_drift", start=1.0, value=0.01))
    assert sensor_kernel.period(nodes, IMU, 0) == 10_000_000
    assert sensor_kernel.period(nodes, IMU, 1_000_000_000) == 10_100_000


def test_a_burst_adds_noise_of_the_stated_size():
    nodes = ideal(ScheduledFault(where="Imu.RollRate", kind="burst", value=0.1))
    values = [
        sensor_kernel.measure(nodes, sensor_kernel.ROLL_RATE, 0.0, k, k, 5) for k in range(4000)
    ]
    assert np.std(np.radians(values)) == pytest.approx(0.1, rel=0.05)


def test_a_dropout_silences_the_whole_node_and_only_it():
    nodes = ideal(ScheduledFault(where="Imu.YawRate", kind="dropout", start=0.1, end=0.2))
    assert not sensor_kernel.silent(nodes, IMU, 99_999_999)
    assert sensor_kernel.silent(nodes, IMU, 100_000_000)
    assert not sensor_kernel.silent(nodes, IMU, 200_000_000)
    assert not sensor_kernel.silent(nodes, sensor_setup.NODES.index("VehicleMotion"), 100_000_000)


def test_the_same_seed_gives_the_same_sensor_and_another_another():
    def run(seed):
        nodes = make(seed=seed)
        return [sent(nodes, IMU, k, k, seed) for k in range(50)]

    assert run(1) == run(1)
    assert run(1) != run(2)


def test_phases_are_seeded_within_the_cycle_or_set():
    drawn = make(seed=9).node[: len(sensor_setup.NODES)]
    assert all(0 <= row["next"] < row["period"] for row in drawn)
    assert len({int(row["next"]) for row in drawn}) == len(drawn)
    assert not make(synchronous=True).node[: len(drawn)]["next"].any()
    assert make(phases={"Imu": 0.0042}).node[IMU]["next"] == 4_200_000


def test_periods_are_those_of_the_dbc():
    nodes = make().node
    for row, name in zip(nodes, sensor_setup.NODES, strict=False):
        cycle = dbc.load().get_message_by_name(name).cycle_time
        assert row["period"] == cycle * 1_000_000
    assert (nodes[len(sensor_setup.NODES) :]["next"] == NEVER).all()


def test_misalignment_and_arm_are_felt():
    nodes = ideal(vehicle=VEHICLE)
    outputs, inputs = np.zeros(ports.N_OUTPUTS), np.zeros(ports.N_INPUTS)
    outputs[ports.ROLL_ACC] = 2.0
    sensor_kernel.observe(nodes, inputs, outputs)
    lateral = nodes.channel[sensor_kernel.LATERAL]["input"]
    arm, askew = VEHICLE.sensors.imu_position, VEHICLE.sensors.imu_misalignment
    gravity = 9.81 + 2.0 * arm[1]
    assert lateral == pytest.approx(-2.0 * arm[2] + gravity * math.sin(askew[0]), abs=1e-3)


def fault(signal="Imu.RollRate", kind="stuck", **when):
    return {"faults": (ScheduledFault(where=signal, kind=kind, **when),)}


@pytest.mark.parametrize(
    ("options", "error", "text"),
    [
        (fault("Imu.RolRate"), UnknownNameError, "Imu.RollRate"),
        (fault(kind="stick"), UnknownNameError, "stuck"),
        (fault(start=2, end=1), CanrollError, "start"),
        (fault(kind="delay", value=9.0), CanrollError, "0 to 2.55 s"),
        (fault(ramp=-1.0), CanrollError, "ramp"),
        (fault(every=0.1, lasting=0.2), CanrollError, "intermittent"),
        ({"faults": fault()["faults"] * 33}, CanrollError, "at most 32"),
        ({"phases": {"Imo": 0.0}}, UnknownNameError, "Imu"),
    ],
)
def test_impossible_options_are_refused(options, error, text):
    with pytest.raises(error, match=text):
        make(**options)
