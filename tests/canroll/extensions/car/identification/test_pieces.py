"""What of a log can be driven: gaps, resets, outliers and standstill."""

import numpy as np
import pytest

from canroll.errors import CanrollError
from canroll.extensions.car.identification.drive_log import (
    INPUTS,
    MOTION,
    Channel,
    Log,
    SignalChoice,
)
from canroll.extensions.car.identification.pieces import RUN_IN, Window, pieces

TIME = 0.01 * np.arange(1000)
USUAL = (*INPUTS, *MOTION)


def logged(time, usual, **channels):
    """A log at times (s) of ``usual`` in all signals but a speed of 20 m/s, and those given."""
    values = {name: usual for name in USUAL} | {"speed": np.full(time.size, 20.0)} | channels
    return Log(
        "drive.csv", {name: Channel(SignalChoice(name), time, v) for name, v in values.items()}
    )


def log_of(time=TIME, **channels):
    """A log with sines of 0.5 Hz in all signals but the speed of 20 m/s."""
    return logged(time, np.sin(np.pi * TIME), **channels)


def test_a_whole_log_is_one_piece_whose_first_second_does_not_count():
    (piece,), remarks = pieces(log_of(), Window())
    assert remarks == ()
    assert piece.measured == pytest.approx(np.tile(np.sin(np.pi * TIME)[:, None], 3))
    counted = piece.compared(Window(-np.inf, 8.0)).all(axis=1)
    assert piece.time[counted][[0, -1]] == pytest.approx([RUN_IN, 7.99])


def test_a_gap_cuts_the_log():
    kept = (TIME < 4.0) | (TIME > 4.5)
    parts, remarks = pieces(logged(TIME[kept], np.sin(np.pi * TIME)[kept]), Window())
    assert [(part.begin, round(part.time[-1], 2)) for part in parts] == [
        (0.0, 3.99),
        (pytest.approx(4.51), pytest.approx(9.99)),
    ]
    assert "yaw rate: 1 gap, the longest of 0.52 s" in remarks


def test_a_clock_that_is_set_back_cuts_the_log():
    time = np.where(TIME < 6.0, TIME, TIME - 5.0)
    parts, remarks = pieces(log_of(time), Window())
    assert [len(part.speed) for part in parts] == [600, 400]
    assert "speed: its time is set back 1 times: cut there" in remarks


def test_stamps_that_repeat_are_left_out():
    time = np.repeat(TIME[::2], 2)
    (piece,), _ = pieces(log_of(time), Window())
    assert np.isfinite(piece.measured).all()


def test_outliers_are_left_out_and_named():
    spoilt = np.sin(np.pi * TIME)
    spoilt[[300, 500]] = 40.0, -40.0
    (piece,), remarks = pieces(log_of(roll_rate=spoilt), Window())
    (line,) = remarks
    assert line.startswith("roll rate: 2 outliers left out, which no car can do: at 3.00, 5.00 s")
    assert np.nanmax(np.abs(piece.measured)) < 1.01


def slowly(rate, **channels):
    """A log of straight driving, at ``rate`` (Hz), but for the signals given over time."""
    time = np.arange(round(20.0 * rate)) / rate
    signals = {name: signal(time) for name, signal in channels.items()}
    return logged(time, np.zeros(time.size), **signals)


@pytest.mark.parametrize("rate", [10.0, 25.0, 100.0])
def test_the_peaks_of_a_hard_manoeuvre_are_no_outliers(rate):
    """Half a second each of a fishhook's roll rate, yaw rate and steering, after quiet driving."""

    def peak(size):
        return lambda t: size * np.exp(-(((t - 10.0) / 0.12) ** 2)) + 1e-4 * np.sin(0.7 * t)

    log = slowly(rate, steering=peak(4.7), yaw_rate=peak(0.8), roll_rate=peak(0.9))
    (piece,), remarks = pieces(log, Window())
    assert not any("outlier" in text for text in remarks)
    shown = np.nanmax(piece.measured, axis=0)
    assert shown[[0, 2]] == pytest.approx([0.8, 0.9], abs=0.01)


@pytest.mark.parametrize(
    ("rate", "frequency", "warned"),
    [(10.0, 1.0, True), (10.0, 0.3, False), (20.0, 1.5, True), (50.0, 1.5, False)],
)
def test_a_log_too_slow_for_its_steering_is_warned_of(rate, frequency, warned):
    log = slowly(rate, steering=lambda t: 2.0 * np.sin(2 * np.pi * frequency * t))
    _, remarks = pieces(log, Window())
    assert any("samples a second are too few" in text for text in remarks) == warned


def test_signals_that_are_not_in_the_log_are_named():
    log = log_of()
    channels = {name: one for name, one in log.channels.items() if name != "roll_rate"}
    (piece,), (remark,) = pieces(Log(log.name, channels), Window())
    assert piece.names == ("yaw_rate", "lateral_acceleration")
    assert remark.startswith("no roll rate in the log")


def test_standstill_is_left_out():
    speed = np.where(TIME < 3.0, 0.0, 20.0)
    (piece,), remarks = pieces(log_of(speed=speed), Window())
    assert piece.begin == pytest.approx(2.99, abs=0.02)
    assert remarks[-1].startswith("3.0 s of 10.0 s left out")


def test_too_little_is_refused():
    with pytest.raises(CanrollError, match=r"at least 2 s are needed"):
        pieces(log_of(), Window(4.0, 4.5))
    with pytest.raises(CanrollError, match=r"begins at 0 s, .* ends at 9\.99 s: 0 s of it are"):
        pieces(log_of(), Window(23.0, 24.0))
    with pytest.raises(CanrollError, match="faster than 18 km/h"):
        pieces(log_of(speed=np.full(TIME.size, 1.0)), Window())


def test_fast_signals_are_means_over_a_sample():
    time = 0.001 * np.arange(10000)
    noise = np.random.default_rng(1).standard_normal(time.size)
    (piece,), _ = pieces(logged(time, noise), Window())
    assert np.std(piece.measured[10:-10]) == pytest.approx(np.sqrt(0.1), rel=0.15)


def sampled(interval, shift, lost=()):
    """A log whose inputs have noise, sampled every ``interval`` (s) from ``shift`` on."""
    generator = np.random.default_rng(2)
    time = shift + interval * np.arange(round(20.0 / interval))
    kept = np.delete(np.arange(time.size), np.array(lost, int))
    signals = {name: (0.01 * np.arange(2000), np.zeros(2000)) for name in USUAL} | {
        "steering": (time, 0.5 * np.sin(np.pi * time)),
        "speed": (time, 22.0 + 1.5 * np.sin(0.4 * time)),
    }
    noise = {"steering": 1e-3, "speed": 0.01}
    channels = {}
    for name, (times, values) in signals.items():
        spoilt = values + noise.get(name, 0.0) * generator.standard_normal(times.size)
        chosen = kept if name in noise else slice(None)
        channels[name] = Channel(SignalChoice(name), times[chosen], spoilt[chosen])
    return Log("drive.csv", channels)


@pytest.mark.parametrize(
    ("interval", "shift", "lost"),
    [
        (0.01, 0.0, ()),
        (0.01, 0.005, ()),
        (0.01, -0.005, ()),
        (0.02, 0.0, ()),
        (0.02, -0.013, ()),
        (0.02, 0.0, range(50, 950, 40)),
        # means of two samples each: the noise is that of a mean
        (0.005, 0.0, ()),
    ],
)
def test_noise_of_the_inputs_is_that_of_their_own_samples(interval, shift, lost):
    """Between samples it is smaller, and no longer white: it would pass for a signal."""
    (piece,), _ = pieces(sampled(interval, shift, lost), Window())
    mean = np.sqrt(min(interval / 0.01, 1.0))
    assert piece.steering_noise.deviation == pytest.approx(mean * 1e-3, rel=0.2)
    assert piece.speed_noise.deviation == pytest.approx(mean * 0.01, rel=0.2)
    true = 22.0 + 1.5 * np.sin(0.4 * piece.time)
    assert np.sqrt(np.mean((piece.speed - true) ** 2)) < 0.3 * 0.01


def test_drawn_errors_of_the_inputs_are_those_of_interpolated_samples():
    """Half way between two of them the variance is half of theirs."""
    (piece,), _ = pieces(sampled(0.01, -0.005), Window())
    drawn = piece.disturbed(np.random.default_rng(1)).steering - piece.steering
    assert np.std(drawn) == pytest.approx(1e-3 / np.sqrt(2), rel=0.2)
