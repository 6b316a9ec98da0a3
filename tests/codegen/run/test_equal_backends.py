"""CPython, native code and a Cortex-M give the same bytes on recorded and disturbed drives."""

from collections import Counter

import numpy as np
import pytest
from support.replays import compare, replayed

from canroll.codegen.run import cortex, ecu_traffic, native, qemu
from canroll.codegen.run.bus_firmware import built_in
from canroll.firmware.state import ACTIVE
from tools.recorded_traffic import CASES, record

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler"),
]
TICKS = 500


@pytest.fixture(scope="module")
def recorded():
    return [record(case, 3.0) for case in (CASES[2], CASES[-1])]


def runs(recorded, first, count):
    """One of four is a random calibration in random traffic, three are disturbed recordings."""
    for k in range(first, first + count):
        if k % 4 == 0:
            traffic = ecu_traffic.random_traffic(k, TICKS, hostile=0.15 if k % 8 == 0 else 0.01)
            yield ecu_traffic.random_calibration(k), traffic
        else:
            chosen = recorded[k % len(recorded)]
            yield chosen.calibration, ecu_traffic.disturbed(chosen.traffic, k)


@pytest.mark.parametrize("first", [1001, pytest.param(2001, marks=pytest.mark.long)])
def test_python_is_native(recorded, first):
    count = 4 if first == 1001 else 120
    for calibration, traffic in runs(recorded, first, count):
        compare(built_in(), calibration, traffic)


@pytest.mark.long
@pytest.mark.skipif(not cortex.has_gcc_and_qemu(), reason="needs gcc-arm-none-eabi and QEMU")
def test_a_cortex_is_native(recorded):
    for calibration, traffic in runs(recorded, 3001, 40):
        on_target = qemu.replay(calibration, traffic, "cortex-m4")
        native_run = replayed(native.library(), calibration, traffic)
        assert on_target.frames.tobytes() == native_run.frames.tobytes()
        assert on_target.states.tobytes() == native_run.states[0].tobytes()


def test_the_loop_is_active_for_a_real_share_and_met_in_all_modes(recorded):
    modes = np.zeros(4, np.int64)
    for calibration, traffic in runs(recorded, 1001, 40):
        states = replayed(native.library(), calibration, traffic).states[0]
        modes += np.bincount(states["mode"], minlength=4)
    assert modes[ACTIVE] > 0.4 * modes.sum()
    assert modes.min() > 0


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
    from canroll.gain_gen.laws import OBSERVERS

    assert {case.actuator for case in CASES} >= {"suspension", "bars", "dampers", "valves"}
    assert {case.observer for case in CASES} >= {None, *OBSERVERS} - {"two_sensors"}
