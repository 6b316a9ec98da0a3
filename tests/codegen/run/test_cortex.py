"""Cortex-M0, M3 and M4 give the bytes of the native library, in both emulators."""

import numpy as np
import pytest
from support.replays import replayed

from canroll.codegen.run import backends, cortex, ecu_traffic, memory_image, native, qemu, unicorn
from canroll.codegen.run.backends import Recorder
from canroll.codegen.worst_case.footprint import FLOAT, footprint
from canroll.firmware.com.signals import RX_IDS
from canroll.firmware.state import ACTIVE, DEGRADED, Ecu
from tools import recorded_traffic

CPUS = [c if c == "cortex-m4" else pytest.param(c, marks=pytest.mark.long) for c in cortex.CPUS]
pytestmark = [
    pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler"),
    pytest.mark.skipif(not cortex.has_pip_tools(), reason="needs canroll[target]"),
]
needs_qemu = pytest.mark.skipif(
    not cortex.has_gcc_and_qemu(), reason="needs arm-none-eabi-gcc and qemu-system-arm"
)


def compare(run, expected):
    for t, state in enumerate(expected.states[0]):
        found, wanted = run.states[t].tobytes(), state.tobytes()
        assert found == wanted, (t, memory_image.differences(Ecu, wanted, found))
    assert run.frames.tobytes() == expected.frames.tobytes()
    assert run.instructions.shape == (len(run.states),)
    assert 0 < run.instructions.min() <= run.instructions.max()
    assert 0 < run.stack < 1024


@pytest.mark.slow
@pytest.mark.parametrize("cpu", CPUS)
def test_unicorn_is_native(cpu):
    for seed in (3, 9):
        both = ecu_traffic.random_calibration(seed), ecu_traffic.random_traffic(seed, 12)
        compare(unicorn.replay(*both, cpu), replayed(native.library(), *both))


@needs_qemu
@pytest.mark.parametrize("cpu", CPUS)
def test_qemu_is_native(cpu):
    for seed in (0, 4):
        both = ecu_traffic.random_calibration(seed), ecu_traffic.random_traffic(seed, 100)
        compare(qemu.replay(*both, cpu), replayed(native.library(), *both))


@needs_qemu
@pytest.mark.slow
def test_qemu_is_native_for_long():
    for seed in range(20):
        both = ecu_traffic.random_calibration(seed), ecu_traffic.random_traffic(seed, 500)
        compare(qemu.replay(*both, "cortex-m4"), replayed(native.library(), *both))


def test_a_cortex_behind_the_interface_replays_what_was_recorded():
    calibration, traffic = ecu_traffic.random_calibration(5), ecu_traffic.random_traffic(5, 15)
    recorder = Recorder(backends.open_backend("native", calibration))
    assert isinstance(recorder, backends.Backend)
    for t in range(traffic.ticks):
        for event in traffic.frames[traffic.frames["tick"] == t]:
            recorder.receive(RX_IDS[event["message"]], event["payload"], int(event["length"]))
        recorder.tick(int(traffic.elapsed[t]))
    again = recorder.traffic
    assert again.frames.tobytes() == traffic.frames.tobytes()
    ecu = backends.open_backend("cortex-m4", calibration)
    assert isinstance(ecu, backends.Backend)
    for t in range(again.ticks):
        for event in again.frames[again.frames["tick"] == t]:
            ecu.receive(RX_IDS[event["message"]], event["payload"], int(event["length"]))
        ecu.tick(int(again.elapsed[t]))
    assert ecu.image() == recorder.image()
    assert memory_image.image(ecu.state) == recorder.image()


@pytest.mark.parametrize("cpu", CPUS)
def test_no_heap_no_float_no_memory_of_its_own(cpu):
    images = [cortex.zig_image(cpu)]
    if cortex.has_gcc_and_qemu():
        images.append(cortex.gcc_image(cpu))
    for image in images:
        size = footprint(image)
        assert size.forbidden == ()
        assert size.static == 0
        assert 0 < size.tables < size.text


# QEMU's counts for a double lane change, with a little room: mean instructions a tick
TICKS = {
    "constant gain": (recorded_traffic.Case("double_lane_change", "lqr"), 7200),
    "without the response monitor": (
        recorded_traffic.Case("double_lane_change", "lqr", response_watch=False),
        3980,
    ),
    "covariance and identification": (
        recorded_traffic.Case(
            "double_lane_change", "lqr", observer="propagated", identification=True
        ),
        12_380,
    ),
}
CODE, TABLES, STATE, STACK = 19_800, 1190, 1500, 256


@needs_qemu
@pytest.mark.parametrize("name", TICKS)
def test_one_build_keeps_to_the_budgets_of_time_and_of_memory(name):
    case, instructions = TICKS[name]
    recording = recorded_traffic.record(case, 5.0)
    run = qemu.replay(recording.calibration, recording.traffic, "cortex-m4")
    assert run.instructions.mean() <= instructions
    assert run.instructions.max() <= 13_100
    assert run.stack <= STACK
    size = footprint(cortex.gcc_image("cortex-m4"))
    assert size.text <= CODE
    assert size.tables <= TABLES
    assert size.state <= STATE


def test_helpers_of_floating_point_are_told_from_those_of_integers():
    for name in (
        "__aeabi_fadd",
        "__aeabi_dmul",
        "__aeabi_i2f",
        "__aeabi_ul2d",
        "__mulsf3",
        "__adddf3",
    ):
        assert FLOAT.match(name), name
    for name in (
        "__aeabi_ldivmod",
        "__aeabi_lmul",
        "__aeabi_idiv0",
        "__aeabi_llsl",
        "__udivmoddi4",
    ):
        assert not FLOAT.match(name), name


MISSED = {
    **{name: case for name, (case, _) in TICKS.items()},
    "compensator": recorded_traffic.Case("double_lane_change", "hinf_nodelay"),
}


@pytest.mark.slow
@needs_qemu
@pytest.mark.parametrize("processor", ["cortex-m0", "cortex-m4"])
@pytest.mark.parametrize("name", MISSED)
def test_a_tick_after_sixteen_missed_is_hardly_longer_than_the_longest(name, processor):
    recording = recorded_traffic.record(MISSED[name], 2.0)
    calm = qemu.replay(recording.calibration, recording.traffic, processor).instructions
    elapsed = recording.traffic.elapsed.copy()
    late = np.arange(60, len(elapsed) - 1, 7)
    elapsed[late] = 17
    storm = ecu_traffic.EcuTraffic(recording.traffic.frames, elapsed)
    run = qemu.replay(recording.calibration, storm, processor)
    assert run.instructions[late].max() <= 1.25 * calm[50:].max()
    assert run.instructions[late + 1].max() <= 1.25 * calm[50:].max()
    assert set(np.unique(run.states["mode"][60:])) <= {ACTIVE, DEGRADED}
