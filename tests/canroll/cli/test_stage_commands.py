"""A calibration with an engineer's own stage: run, proved, timed, exported; refused in one line."""

import json
import re
import shutil
from pathlib import Path

import pytest
from support.bundles import make

from canroll.cli.main import main
from canroll.codegen.run import cortex, native
from canroll.gain_gen.calibration import calibration_file
from canroll.runs.experiment import plan

EXAMPLE = Path(__file__).parents[3] / "examples" / "own_stage" / "progressive.py"
SHORT = ("--plant", "roll1", "--duration", "2", "--bus", "500k")

needs_cc = pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler")


@pytest.fixture(scope="module")
def calibration(tmp_path_factory):
    """A design that carries the example, whose file is not there any more."""
    folder = tmp_path_factory.mktemp("own_stage")
    stage = shutil.copy(EXAMPLE, folder)
    assert main(["design", "--law", "lqr", "--stage", str(stage), "--out", str(folder)]) == 0
    Path(stage).unlink()
    return folder / "calibration.toml"


def refused(words, capsys):
    capsys.readouterr()
    assert main([str(word) for word in words]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    return line


def test_the_calibration_carries_the_source(calibration, tmp_path):
    loaded = calibration_file.load(calibration)
    assert loaded.stage.name == "progressive" and loaded.stage.source == EXAMPLE.read_text()
    again = tmp_path / "calibration.toml"
    calibration_file.save(again, loaded.record, loaded.tables)
    assert again.read_bytes() == calibration.read_bytes()


def test_a_calibration_may_name_a_file_beside_it(calibration, tmp_path):
    text = re.sub(r"^source = .*\n", "", calibration.read_text(), flags=re.M)
    (tmp_path / "calibration.toml").write_text(text)
    shutil.copy(EXAMPLE, tmp_path)
    found = calibration_file.load(tmp_path / "calibration.toml").stage
    assert found == calibration_file.load(calibration).stage


def test_a_run_has_the_stage_in_its_loop_and_is_read_back(calibration, tmp_path, capsys):
    words = ("run", "double_lane_change", "--calibration", str(calibration), *SHORT)
    assert main([*words, "--out", str(tmp_path)]) in (0, 1)
    assert "lqr and progressive over 500k" in capsys.readouterr().out
    without = tmp_path / "without.toml"
    text = calibration.read_text()
    without.write_text(
        text[: text.index("[stage]")] + text[text.index("\n[", text.index("[stage]")) :]
    )
    moments = {}
    for path in (calibration, without):
        main(["run", "double_lane_change", "--calibration", str(path), *SHORT, "--json"])
        moments[path] = json.loads(capsys.readouterr().out)["controlled"]["moment_rms_nm"]
    assert moments[calibration] < moments[without]
    assert main(["run", str(tmp_path), "--json"]) in (0, 1)
    assert json.loads(capsys.readouterr().out)["controlled"]["moment_rms_nm"] == pytest.approx(
        moments[calibration]
    )
    settings, _ = plan("double_lane_change", calibration=calibration)
    assert settings.firmware.stage is not None


@pytest.mark.long
def test_the_proof_covers_it(calibration, capsys):
    assert main(["prove", str(calibration)]) == 0
    assert "stage progressive.py" in capsys.readouterr().out
    assert main(["prove", "--stage", str(EXAMPLE), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["proved"] and answer["for"].endswith("progressive.py")


def test_the_margins_say_that_they_are_without_it(calibration, capsys):
    main(["margins", str(calibration)])
    assert "without the stage progressive.py" in capsys.readouterr().out.replace("\n", " ")
    main(["margins", str(calibration), "--json"])
    assert json.loads(capsys.readouterr().out)["without_stage"] == "progressive"


@pytest.mark.skipif(not cortex.has_pip_tools(), reason="needs canroll[target]")
def test_it_costs_instructions_on_the_target(calibration, capsys):
    words = ["timing", "--duration", "0.3", "--counter", "unicorn", "--processor", "cortex-m4"]
    seen = []
    for more in (["--law", "lqr"], ["--calibration", str(calibration)]):
        assert main([*words, *more, "--json"]) == 0
        seen.append(json.loads(capsys.readouterr().out))
    plain, staged = seen
    assert 20 <= staged["instructions"]["mean"] - plain["instructions"]["mean"] <= 120
    assert staged["bytes"]["state"] == plain["bytes"]["state"] + 8


@pytest.mark.slow
@pytest.mark.skipif(not cortex.has_gcc_and_qemu(), reason="needs arm-none-eabi-gcc and QEMU")
def test_its_worst_case_is_bounded(calibration, capsys):
    words = ["timing", "--bound", "--calibration", str(calibration), "--ticks", "300", "--json"]
    assert main([*words, "--duration", "1"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["cycles"]["seen"] <= answer["cycles"]["bound"]
    assert any("stage" in name for name in answer["functions"])


@pytest.mark.long
@needs_cc
@pytest.mark.skipif(not shutil.which("make"), reason="needs make")
def test_the_bundle_has_it_and_passes_its_vectors(calibration, tmp_path):
    assert main(["export-c", str(tmp_path), "--calibration", str(calibration)]) == 0
    assert (tmp_path / "stage" / "progressive.py").read_text() == EXAMPLE.read_text()
    assert "stage/progressive.py" in (tmp_path / "README.md").read_text()
    assert "ecu.swing" in (tmp_path / "canroll.a2l").read_text()
    assert "PASS" in make(tmp_path, "test").stdout


@pytest.mark.slow
def test_two_processes_run_it_too(calibration, capsys):
    words = ("hil", "double_lane_change", "--pace", "lockstep", "--calibration", str(calibration))
    # the run replays what the ECU's process did, and fails where a frame differs
    assert main([*words, "--duration", "1", "--plant", "roll1"]) in (0, 1)
    assert "lqr and progressive" in capsys.readouterr().out


@pytest.mark.slow
def test_what_cannot_be_is_refused_in_one_line(calibration, tmp_path, capsys):
    run = ("run", "double_lane_change", *SHORT)
    line = refused((*run, "--calibration", calibration, "--stage", EXAMPLE), capsys)
    assert "the calibration carries the stage progressive.py: omit --stage" in line
    assert "cannot read stage none.py" in refused((*run, "--stage", "none.py"), capsys)
    broken = tmp_path / "broken.py"
    broken.write_text(EXAMPLE.read_text().replace("ecu.swing = 0", "ecu.swing = 0.5"))
    assert f"{broken}:40: " in refused(("design", "--stage", broken, "--out", tmp_path), capsys)
    assert not (tmp_path / "calibration.toml").exists()
    line = refused(("design", "--compare", "--stage", EXAMPLE), capsys)
    assert "--compare designs laws without a stage" in line
    text = calibration.read_text()
    own = tmp_path / "own.toml"
    for old, new, rule in (
        ('file = "progressive.py"', 'name = "progressive.py"', "[stage] has the keys file"),
        ('file = "progressive.py"', "file = 3", "file and source are texts"),
        (
            "ecu.factor = LEAST\\n\\n\\ndef rest",
            "ecu.mode = 3\\n\\n\\ndef rest",
            "stores in its own",
        ),
    ):
        assert old in text
        own.write_text(text.replace(old, new))
        assert rule in refused((*run, "--calibration", own), capsys)


@pytest.mark.long
@needs_cc
@pytest.mark.skipif(not shutil.which("make"), reason="needs make")
def test_code_for_one_calibration_has_it_too(calibration, tmp_path):
    words = ("export-c", str(tmp_path), "--calibration", str(calibration), "--specialise")
    assert main(words) == 0
    assert "translated to `src/canroll_ecu.c`" in (tmp_path / "README.md").read_text()
    assert "swing" in (tmp_path / "src" / "canroll_ecu.c").read_text()
    assert make(tmp_path, "test").stdout.count("PASS") == 2


STAGE = """
from canroll.firmware.calibration import Calibration
from canroll.firmware.state import Ecu
from canroll.firmware.subset import i32
LIMIT = 30

def moment(ecu: Ecu, cal: Calibration, wanted: i32, output: i32, steps: i32) -> i32:
    if {condition}:
        return wanted >> 1
    return wanted
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    "condition",
    [
        *("ecu.speed > 30", "-3 < ecu.lateral_acceleration", "ecu.speed - 30 > 0"),
        *("0 < 30 - ecu.speed", "ecu.speed > LIMIT", "ecu.speed - LIMIT >= 0"),
    ],
)
def test_a_scaled_field_is_not_compared_with_a_bare_number(condition, tmp_path, capsys):
    path = tmp_path / "stage.py"
    path.write_text(STAGE.format(condition=condition))
    assert main(["prove", "--stage", str(path)]) == 2
    told = capsys.readouterr().err
    assert "stage.py:8: ecu." in told and "fractional bits" in told
    assert any(f"'{number} << " in told for number in ("30", "-3", "LIMIT"))


@pytest.mark.slow
def test_a_number_in_the_format_of_the_field_is(tmp_path):
    conditions = ("ecu.speed > 30 << 20", "ecu.speed > 0", "ecu.mode == 2")
    conditions += ("ecu.speed > LIMIT << 20", "ecu.speed - (30 << 20) > 0")
    branch = "    if {condition}:\n        return wanted >> 1\n"
    assert branch in STAGE
    branches = "".join(branch.format(condition=condition) for condition in conditions)
    path = tmp_path / "stage.py"
    path.write_text(STAGE.replace(branch, branches))
    assert main(["prove", "--stage", str(path)]) == 0
