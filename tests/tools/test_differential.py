"""The long comparison of the backends: what it is fed, and that it finds a difference."""

from collections import Counter

import numpy as np
import pytest

from codegen.run import ecu_traffic, native
from firmware.state import ACTIVE
from tools.differential import __main__ as differential
from tools.differential.recorded_traffic import CASES, record

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler"),
]


@pytest.fixture(scope="module")
def recorded():
    return [record(case, 3.0) for case in (CASES[2], CASES[-1])]


def test_python_is_native_on_recorded_and_disturbed_runs(recorded):
    for task in differential.tasks(1300, 1001, recorded, None):
        outcome = differential.compare(task)
        assert outcome.difference == ""
        assert outcome.modes.sum() == task.traffic.ticks


def test_the_loop_is_active_for_a_real_share_and_met_in_all_modes(recorded):
    modes = np.zeros(4, np.int64)
    for task in differential.tasks(12_000, 1001, recorded, None):
        run = differential.reference(task.calibration, task.traffic)
        modes += np.bincount(run.states[0]["mode"], minlength=4)
    assert modes[ACTIVE] > 0.4 * modes.sum()
    assert modes.min() > 0


def test_a_difference_is_found_and_named(recorded, monkeypatch):
    first = recorded[0]
    task = differential.Task("one", first.calibration, first.traffic, None)
    sound = differential.python_states(first.calibration, first.traffic)
    broken = [*sound[:7], bytes(len(sound[7])), *sound[8:]]
    monkeypatch.setattr(differential, "python_states", lambda *_: broken)
    found = differential.compare(task).difference
    assert found.startswith("one: python differs in tick 7: ")


def test_disturbed_traffic_hurts_in_episodes_only(recorded):
    traffic = recorded[0].traffic
    hurt = ecu_traffic.disturbed(traffic, 5)
    before, after = (Counter(f.tobytes() for f in t.frames) for t in (traffic, hurt))
    lost = before - after
    assert 0 < sum(lost.values()) < 0.2 * len(traffic.frames)
    assert np.array_equal(ecu_traffic.disturbed(traffic, 5).frames, hurt.frames)
    ticks = {np.frombuffer(f, ecu_traffic.EVENT)["tick"][0] for f in lost}
    assert len(ticks) < 0.2 * traffic.ticks


def test_the_cases_are_all_actuators_and_observers():
    from gain_gen.laws import OBSERVERS

    assert {case.actuator for case in CASES} >= {"suspension", "bars", "dampers", "valves"}
    assert {case.observer for case in CASES} >= {None, *OBSERVERS} - {"two_sensors"}
