"""The phase of the ticks: chosen, measured, and what it costs."""

import json

import numpy as np
import pytest

from canroll.cli.main import main
from canroll.errors import CanrollError
from canroll.plant_sim.can_bus import DELIVERED, ECU
from canroll.runs import experiment, phase

MS = 1_000_000


def run(**choices):
    return experiment.run("double_lane_change", law="lqr", duration=1.5, **choices)


@pytest.mark.parametrize("bus", ["500k", "125k_busy"])
@pytest.mark.parametrize("chosen", [0.0, 2.5, 9.0])
def test_the_phase_that_is_chosen_is_kept(bus, chosen):
    """From the earliest that an Imu frame can come, whatever the single frame was delayed by."""
    result = run(bus=bus, seed=7, phase_ms=chosen)
    frames = result.controlled.frames
    ecu = frames["segment"][frames["sender"] == ECU][0]
    imu = frames[(frames["ident"] == phase.IMU) & (frames["segment"] == ecu)]
    imu = imu[imu["outcome"] == DELIVERED]
    earliest = imu["t_origin"][0] + np.min(imu["t_received"] - imu["t_origin"])
    ticks = 1e3 * result.controlled.ticks["t"]
    kept = (ticks - 1e-6 * earliest - chosen + 5) % 10 - 5
    assert np.all(np.abs(kept) < 0.1)
    answer = result.to_json()["phase_ms"]
    assert answer["chosen"] == chosen
    assert 0 <= answer["least"] <= answer["mean"] <= answer["most"]
    assert answer["least"] <= chosen + 0.1


def test_by_default_it_is_what_clocks_that_start_together_have():
    settings, _ = experiment.plan("double_lane_change", law="lqr", seed=4)
    natural = experiment.tick_phase_ns(settings)
    assert experiment.tick_offset_ns(settings) == 0
    result = run(seed=4)
    same = run(seed=4, phase_ms=natural / MS)
    assert same.controlled.frames.tobytes() == result.controlled.frames.tobytes()


def test_a_later_tick_uses_older_samples():
    ages = [run(seed=7, phase_ms=chosen).can.age_ms.mean for chosen in (1.0, 4.0, 7.0)]
    assert np.diff(ages) == pytest.approx(3.0, abs=1.0)


@pytest.mark.parametrize(
    ("choices", "told"),
    [
        ({"phase_ms": -1.0}, "the phase must be at least 0 and below 10 ms, got -1 ms"),
        ({"phase_ms": 10.0}, "below 10 ms"),
        ({"phase_ms": 5.0, "tick_ms": 5.0}, "below 5 ms"),
        ({"phase_ms": 1.0, "tick_ms": 7.0}, "a tick of 7 ms has no phase"),
    ],
)
def test_a_phase_that_cannot_be_is_refused(choices, told):
    with pytest.raises(CanrollError, match=told):
        experiment.plan("double_lane_change", law="lqr", **choices)


def test_over_a_gateway_that_delays_at_random_there_is_none():
    with pytest.raises(CanrollError, match=r"Imu frames take .* ms on this bus"):
        run(bus="gateway_20ms", phase_ms=1.0)


def test_without_imu_frames_there_is_none():
    settings, _ = experiment.plan("double_lane_change", law="lqr")
    world = experiment.build_world(
        experiment.replace(settings, faults=("Imu.RollRate=dropout",)), enabled=False
    )
    with pytest.raises(CanrollError, match="no Imu frame reaches the ECU"):
        phase.earliest_arrival_ns(world)


def test_runs_are_compared_over_the_phase(capsys):
    runs = ["phase=1", "phase=6"]
    assert main(["compare", *runs, "--law", "lqr", "--duration", "1", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    found = [entry["phase_ms"]["chosen"] for entry in answer["runs"]]
    assert found == [1.0, 6.0]
