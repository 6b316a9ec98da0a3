"""Specialised firmware is the general one for its calibration, byte for byte, and for no other."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from support.replays import images, replayed

from canroll.codegen.generated import own_stage
from canroll.codegen.run import ecu_traffic, memory_image, native
from canroll.codegen.run.bus_firmware import built_in, with_stage
from canroll.codegen.run.specialised import specialised
from canroll.errors import CanrollError
from canroll.firmware import ecu as loop
from canroll.firmware.calibration import Calibration
from canroll.firmware.check import RULE_CRC
from canroll.firmware.state import ACTIVE, DEGRADED, INIT, SAFE, Ecu
from tools import recorded_traffic
from tools.recorded_traffic import Case

pytestmark = pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler")
ROOT = Path(__file__).parents[3]
MODES = {INIT, ACTIVE, DEGRADED, SAFE}
OTHERS = (
    Case("double_lane_change", "lqr", observer="propagated", identification=True),
    Case("double_lane_change", "lqr", observer="reference", actuator="dampers"),
    Case("j_turn", "hinf_delay"),
    Case("double_lane_change", "lqr_full_car", actuator="valves"),
)
FEW = (
    Case("double_lane_change", "lqr"),
    pytest.param(Case("j_turn", "lqg_delay", actuator="bars"), marks=pytest.mark.long),
)


def difference(calibration, traffic):
    """Name the fields in which the first tick differs that does."""
    special = specialised(built_in(), calibration)
    general, own = (
        replayed(library, calibration, traffic)
        for library in (native.library(), native.library_of(special))
    )
    for tick, (one, two) in enumerate(zip(general.states[0], own.states[0], strict=True)):
        if one.tobytes() != two.tobytes():
            fields = memory_image.differences(Ecu, one.tobytes(), two.tobytes())
            return f"tick {tick}: {', '.join(fields)}"
    return "" if general.frames.tobytes() == own.frames.tobytes() else "frames"


@pytest.fixture(scope="module", params=FEW, ids=lambda case: case.law)
def recording(request):
    return recorded_traffic.record(request.param, 4.0)


@pytest.mark.slow
def test_same_bytes_in_hostile_traffic(recording):
    calibration, plain = recording.calibration, recording.traffic
    hurt = [ecu_traffic.disturbed(plain, seed, quiet=60.0) for seed in range(8)]
    hurt += [ecu_traffic.storm(plain, seed) for seed in range(4)]
    hurt += [ecu_traffic.random_traffic(seed, 400, hostile=0.03) for seed in range(4)]
    modes = set()
    for traffic in [plain, *hurt]:
        assert difference(calibration, traffic) == ""
        states = replayed(native.library(), calibration, traffic).states
        modes |= set(np.unique(states["mode"]).tolist())
    assert modes == MODES


@pytest.mark.parametrize(
    "seed",
    [pytest.param(seed, marks=pytest.mark.long if seed else pytest.mark.slow) for seed in range(3)],
)
def test_any_calibration_can_be_specialised(seed):
    """Coefficients anywhere in their ranges, options in any combination."""
    calibration = ecu_traffic.random_calibration(seed)
    for hostile in (0.01, 0.15):
        traffic = ecu_traffic.random_traffic(seed, 800, hostile=hostile)
        assert difference(calibration, traffic) == ""


@pytest.mark.long
@pytest.mark.parametrize("case", OTHERS, ids=str)
def test_every_law_actuator_and_observer(case):
    recording = recorded_traffic.record(case, 3.0)
    for traffic in (
        recording.traffic,
        ecu_traffic.disturbed(recording.traffic, 5),
        ecu_traffic.storm(recording.traffic, 6),
    ):
        assert difference(recording.calibration, traffic) == ""


@pytest.mark.long
def test_an_own_stage_is_specialised_with_the_loop(calibration):
    stage = own_stage.read(ROOT / "examples" / "own_stage" / "progressive.py")
    firmware = with_stage(built_in(), stage)
    special = specialised(firmware, calibration)
    traffic = ecu_traffic.random_traffic(2, 800)
    general, own = (
        replayed(native.library_of(each), calibration, traffic) for each in (firmware, special)
    )
    assert general.states.tobytes() == own.states.tobytes()
    assert general.frames.tobytes() == own.frames.tobytes()


@pytest.fixture(scope="module")
def special(calibration):
    return specialised(built_in(), calibration)


@pytest.fixture(scope="module")
def calibration():
    return ecu_traffic.random_calibration(6)


def test_what_is_off_is_gone(special, calibration):
    text = special.files["canroll_ecu.c"]
    assert calibration.observer != 2
    assert "canroll_covariance_update" in built_in().files["canroll_covariance.c"]
    assert "canroll_covariance_update" not in text
    assert "cal->" not in text


@pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc")
def test_nothing_that_is_off_leaves_something_unused(special, tmp_path):
    for name, text in special.files.items():
        (tmp_path / name).write_text(text)
    strict = ["-std=c99", "-Wall", "-Wextra", "-Wshadow", "-Wpedantic", "-Werror", "-O1", "-c"]
    subprocess.run(["gcc", *strict, "canroll_ecu.c"], cwd=tmp_path, check=True, timeout=600)


def test_all_functions_are_in_one_file(special):
    files = {name for name in special.files if name.endswith(".c")}
    assert files == {"canroll_ecu.c", "canroll_limits.c"}
    general = built_in().files
    assert special.files["canroll_state.h"] == general["canroll_state.h"]


@pytest.mark.parametrize("name", ["feedback", "moment_max", "output_gain"])
def test_another_calibration_is_refused_though_its_own_crc_is_right(special, calibration, name):
    other = Calibration()
    memory_image.fill(other, memory_image.image(calibration))
    value = getattr(other, name)
    if isinstance(value, list):
        value[0] ^= 1
    else:
        setattr(other, name, value ^ 1)
    memory_image.sealed(other)
    assert loop.init(Ecu(), other) == 0
    library = native.library_of(special)
    with pytest.raises(CanrollError, match=f"rule {RULE_CRC}"):
        library.start(images(other))


def test_a_refused_ecu_does_nothing(special, calibration):
    library = native.library_of(special)
    other = memory_image.sealed(ecu_traffic.random_calibration(5))
    ecus, cals = np.zeros(1, memory_image.dtype(Ecu)), images(other)
    buffer = library.ffi.from_buffer
    assert library.lib.canroll_init(buffer(ecus), buffer(cals)) == RULE_CRC
    assert ecus["mode"][0] == SAFE
    before = ecus.tobytes()
    library.lib.canroll_tick(buffer(ecus), buffer(cals), 1)
    assert ecus.tobytes() == before


def test_a_calibration_that_changes_while_running_ends_in_safe(special, calibration):
    library = native.library_of(special)
    cals = images(calibration)
    ecus = library.start(cals)
    cals["feedback"][0][0] ^= 4
    traffic = ecu_traffic.random_traffic(1, 900, hostile=0.0)
    states = library.replay(ecus, cals, [traffic], states=True).states
    assert states["mode"][0][-1] == SAFE


def test_a_calibration_that_the_check_refuses_is_not_specialised(calibration):
    wrong = Calibration()
    memory_image.fill(wrong, memory_image.image(calibration))
    wrong.fade_high = wrong.fade_low
    with pytest.raises(CanrollError, match="refuses the calibration"):
        specialised(built_in(), memory_image.sealed(wrong))
