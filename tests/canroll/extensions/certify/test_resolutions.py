"""The half steps of a certificate: those of the signals of the bus that was designed for."""

from dataclasses import replace
from pathlib import Path

import pytest

from canroll import vehicles
from canroll.cli import main as cli
from canroll.errors import CanrollError
from canroll.extensions.certify.subject import resolutions, subject
from canroll.firmware.calibration import Calibration
from canroll.gain_gen.calibration import calibration_file
from canroll.gain_gen.calibration.resolution import of_contract
from canroll.gain_gen.margin_report import task_of
from canroll.gain_gen.models.task import Resolution

OWN = Path(__file__).parents[4] / "examples" / "own_bus"
COARSE = (
    ('(0.005,0) [0|163.83] "Unit_DegreOfArcPerSecon" RollController\n SG_ GY_YawRate', "(0.5,0)"),
    ("(0.0001,0) [-3.2767|3.2765]", "(0.01,0)"),
)


@pytest.mark.slow
def test_a_certificate_has_the_steps_of_the_bus_designed_for(tmp_path, capsys):
    """A roll rate of a hundred times the step, and an acceleration too."""
    text = (OWN / "own.dbc").read_text(encoding="utf-8")
    for old, new in COARSE:
        assert text.count(old) == 1
        text = text.replace(old, new + old[old.index(" ") :])
    (tmp_path / "coarse.dbc").write_text(text, encoding="utf-8")
    found = []
    for name, dbc in (("own", OWN / "own.dbc"), ("coarse", tmp_path / "coarse.dbc")):
        command = ["design", "--law", "hinf_event", "--actuator", "suspension", "--dbc", str(dbc)]
        command += ["--map", str(OWN / "own.toml"), "--out", str(tmp_path / name)]
        assert cli.main(command) == 0
        calibration = calibration_file.load(tmp_path / name / "calibration.toml")
        content = subject(task_of(calibration), calibration)[1]
        found.append([int(half) - 4 for half in content["resolution"]])
    own, coarse = found
    assert coarse[0] == pytest.approx(100 * own[0], rel=1e-3)
    assert coarse[1] == pytest.approx(100 * own[1], rel=1e-3)
    assert coarse[2:] == own[2:]
    capsys.readouterr()


def test_what_the_loop_requires_must_be_on_the_bus():
    record, van = Calibration(), vehicles.load("van_real")
    record.measurements, record.timeout_ticks, record.actuator = 1, [5] * 5, 1
    steps = replace(of_contract(), lateral_acceleration=0.0, force=0.0)
    assert resolutions(van, record, steps)[1] == "4"
    for lacking in ("roll_rate", "delivered", "bar"):
        with pytest.raises(CanrollError, match=f"mapped to {lacking}: map one"):
            resolutions(van, record, replace(steps, **{lacking: 0.0}))
    with pytest.raises(CanrollError, match="does not have the resolutions of its bus"):
        resolutions(van, record, None)
    assert Resolution(*[0.0] * 6) != steps
