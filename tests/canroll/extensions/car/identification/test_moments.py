"""Logs of a controlled car: its moments act on the simulated one, and tell of its actuators."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import StateSpace, lsim

from canroll import dbc, vehicles
from canroll.cli.main import main
from canroll.errors import CanrollError
from canroll.extensions.car.identification.drive_log import (
    DELIVERED,
    INPUTS,
    MOTION,
    Channel,
    Log,
    SignalChoice,
    read,
)
from canroll.extensions.car.identification.fit import FitSettings, fit
from canroll.extensions.car.identification.moments import moments
from canroll.extensions.car.identification.pieces import EVERYTHING, Window, pieces
from canroll.extensions.car.identification.replay import ROLL, motion
from canroll.extensions.car.identification.unknowns import NUMBERS
from canroll.vehicles import GRAVITY
from canroll.vehicles.axles import axles
from canroll.vehicles.roll_stiffness import suspension_roll_stiffness

VAN = vehicles.load("van_real")
TIME = 0.01 * np.arange(600)
COMMAND = 1500.0 * np.sin(3.0 * TIME) * np.cos(17.0 * TIME)
LAGS = {"front": 0.03, "rear": 0.03}


def lagged(lag, command=COMMAND, gain=1.0):
    """What a lag delivers, by SciPy, with the noise of a pressure sensor."""
    fine = np.repeat(command, 100)
    system = StateSpace([[-1 / lag]], [[1 / lag]], [[gain]], [[0.0]])
    _, moment, _ = lsim(system, fine, 1e-4 * np.arange(fine.size), interp=False)
    return moment[::100] + np.random.default_rng(1).normal(0.0, 10.0, command.size)


def log_of(**values):
    """Return a log that drives straight, but for the signals given."""
    signals = {name: np.zeros(TIME.size) for name in (*INPUTS, *MOTION)} | {
        "speed": np.full(TIME.size, 20.0),
        **values,
    }
    channels = {n: Channel(SignalChoice(n), TIME, np.asarray(v)) for n, v in signals.items()}
    return Log("drive.csv", channels)


def test_the_lag_of_both_axles_is_that_of_the_file():
    both = {f"commanded_{axle}": COMMAND for axle in LAGS}
    both |= {f"delivered_{axle}": lagged(lag) for axle, lag in LAGS.items()}
    result = moments(log_of(**both), VAN)
    assert result.lag.unknown.key == "actuators.bars.lag"
    assert result.lag.value == pytest.approx(0.03, abs=3 * result.lag.deviation)
    assert result.lag.deviation < 1e-3
    assert result.remarks == ()


def test_axles_that_differ_are_named_and_make_the_lag_unsure():
    both = {f"commanded_{axle}": COMMAND for axle in LAGS}
    both |= {"delivered_front": lagged(0.02), "delivered_rear": lagged(0.06)}
    result = moments(log_of(**both), VAN)
    assert "one lag for both axles, which differ" in result.remarks[0]
    assert result.lag.deviation > 0.01


def test_a_lag_that_is_given_or_held_is_kept_and_compared():
    pair = {"commanded_front": COMMAND, "delivered_front": lagged(0.03)}
    given = VAN.replace({"actuators.bars.lag": 0.012})
    for result in (
        moments(log_of(**pair), given),
        moments(log_of(**pair), VAN, held=["actuators.bars.lag"]),
    ):
        assert result.lag is None
        assert any(
            "held at 0.01" in text and "the log has 0.029" in text for text in result.remarks
        )
    assert moments(log_of(**pair), given, free=["actuators.bars.lag"]).lag is not None


def test_corner_forces_are_the_moments_of_a_suspension():
    track = 2.0 * axles(VAN)[0].half_track
    forces = {
        "commanded_force_front_left": COMMAND / track,
        "commanded_force_front_right": -COMMAND / track,
    }
    result = moments(log_of(**forces, delivered_front=lagged(0.03, gain=0.9)), VAN)
    assert result.lag.unknown.key == "actuators.suspension.lag"
    _, delay, gain, _ = result.actuators[0].numbers
    assert gain.value == pytest.approx(0.9, abs=3 * gain.deviation)
    assert delay.value == pytest.approx(0.0, abs=3 * delay.deviation)


def test_a_command_alone_acts_through_the_other_axles_actuator_else_through_the_files():
    both = {"commanded_front": COMMAND, "commanded_rear": COMMAND}
    alone = moments(log_of(**both), VAN)
    assert all("with the file's lag of 0.01 s" in text for text in alone.remarks)
    other = moments(log_of(**both, delivered_front=lagged(0.03, gain=0.8)), VAN)
    assert any("through the actuator front" in text for text in other.remarks)
    for result, truth in ((alone, lagged(0.01)), (other, lagged(0.03, gain=0.8))):
        rear = result.log.channels["delivered_rear"]
        expected = np.interp(rear.times, TIME, truth)
        assert np.std(rear.values - expected) < 30.0  # the sensor's noise, and the fit's


@pytest.mark.parametrize(
    ("signals", "message"),
    [
        (
            {"commanded_front": COMMAND, "delivered_front": -lagged(0.03)},
            "its sign is reversed .* give --signal delivered_front=-delivered_front",
        ),
        (
            {"commanded_front": 0.0 * COMMAND, "delivered_front": lagged(0.03)},
            "it moves, but its command is constant",
        ),
        (
            {"commanded_front": COMMAND, "delivered_front": 1e-3 * lagged(0.03)},
            "give --signal delivered_front=delivered_front:kNm",
        ),
        (
            {"commanded_front": COMMAND, "delivered_front": 900.0 * np.sin(1.7 * TIME)},
            "it has nothing to do with its command",
        ),
        ({"commanded_force_rear_left": COMMAND}, "the force of the other side is missing"),
        (
            {"kind": "suspension", "delivered_front": COMMAND},
            "--actuator suspension: no axle has commanded and",
        ),
        (
            {"kind": "bars", "commanded_force_rear_left": COMMAND},
            "--actuator bars, but it has commanded corner forces",
        ),
    ],
)
def test_moments_that_cannot_be_an_actuators_are_refused(signals, message):
    values = {name: values for name, values in signals.items() if name != "kind"}
    with pytest.raises(CanrollError, match=message):
        moments(log_of(**values), VAN, signals.get("kind", ""))


@pytest.mark.parametrize(
    ("command", "reason"),
    [
        (0.0 * COMMAND, "its command never moves"),
        (COMMAND, "it delivers nothing of its command, as if switched off"),
    ],
)
def test_an_actuator_of_which_nothing_is_told_is_named(command, reason):
    still = {"commanded_front": command, "delivered_front": 0.0 * COMMAND}
    result = moments(log_of(**still), VAN)
    assert result.actuators == ()
    assert result.lag is None
    assert result.remarks[0].startswith(f"actuator front: {reason}: the log tells nothing")


def test_moments_of_another_part_tell_nothing_of_the_actuator():
    pair = {"commanded_front": COMMAND, "delivered_front": lagged(0.03)}
    result = moments(log_of(**pair), VAN, window=Window(5.8, 9.0))
    assert "less than 1 s with commanded and delivered moment" in result.remarks[0]


def test_a_moment_that_rolls_the_body_outwards_is_named():
    log = log_of(delivered_front=COMMAND, delivered_rear=-COMMAND, lateral_acceleration=COMMAND)
    (text,) = moments(log, VAN).remarks
    assert text.startswith("delivered moment, front: it rolls the body out of the curve")


def test_a_constant_moment_leans_the_standing_body_by_its_stiffness():
    """Balance of the body and of each axle on its tyres, of moments M on them and φ of the body.

    K_s (φ − φ_w) − M = K_t φ_w of an axle, and Σ K_t φ_w = m g h φ of all.
    """
    steady = log_of(delivered_front=np.full(TIME.size, 1500.0))
    (piece,), _ = pieces(moments(steady, VAN).log, EVERYTHING)
    roll = motion(VAN, piece, 0.0)[-1, ROLL]
    springs = suspension_roll_stiffness(VAN)
    tyres = [2.0 * VAN.tyre.vertical_stiffness * axle.half_track**2 for axle in axles(VAN)]
    own = [axle.roll_share * springs for axle in axles(VAN)]
    both = sum(t * s / (t + s) for t, s in zip(tyres, own, strict=True))
    leant = 1500.0 * tyres[0] / (tyres[0] + own[0]) / (both - GRAVITY * VAN.plant.roll_arm)
    assert roll == pytest.approx(leant, rel=0.03)


@pytest.mark.slow
def test_without_its_moments_a_controlled_car_seems_stiffer(tmp_path):
    """A run on the bus is fitted as it was recorded; its stiffness is that of the vehicle."""
    bus = tmp_path / "drive.log"
    options = ["--log", str(bus), "--out", str(tmp_path), "--no-trace"]
    assert main(["run", "double_lane_change", "--vehicle", "van_real", *options]) == 0
    log = read(str(bus), {}, dbc=str(dbc.PATH), map_file=str(dbc.PATH.with_suffix(".toml")))
    free = ("plant.roll_stiffness", "plant.roll_damping")
    held = tuple(key for key in NUMBERS if key not in free)
    settings = FitSettings(starts=1, held=held)

    def stiffness(log):
        result = fit(log, VAN, settings)
        return next(n for n in result.numbers if n.unknown.key == "plant.roll_stiffness"), result

    known, result = stiffness(log)
    truth = VAN.plant.roll_stiffness
    assert abs(known.value - truth) < 1.96 * known.deviation
    assert result.vehicle.source("actuators.bars.lag").startswith("fitted ±")
    assert "actuators.bars.lag" in result.vehicle.fit.names
    others = {n: c for n, c in log.channels.items() if n in (*INPUTS, *MOTION, "roll")}
    assert not {*DELIVERED} & {*others}
    blind, _ = stiffness(replace(log, channels=others))
    assert blind.value - truth > 1.96 * blind.deviation
