"""A law of the user's own: never changed; refused, or marked, where it fails a check."""

import re
from dataclasses import replace

import numpy as np
import pytest

from canroll import vehicles
from canroll.errors import CanrollError, VerdictError
from canroll.gain_gen.calibration import calibration_file
from canroll.gain_gen.calibration.freeze import calibrate
from canroll.gain_gen.calibration.summary import summary
from canroll.gain_gen.design import design
from canroll.gain_gen.laws import LAWS, declared
from canroll.gain_gen.models.task import Delay, Task

GAINS = [60_000.0, 9_000.0]
PYTHON = """
import numpy as np

from canroll.gain_gen.laws.state_feedback import observer_of
from canroll.gain_gen.models.controller import LinearController
from canroll.gain_gen.models.task import Solution


def law(task):
    '''The gains of the file.'''
    feedback = np.array([60_000.0, 9_000.0, 0.0, 0.0, 0.0])
    return Solution(LinearController(task.tick, observer_of(task), feedback, np.zeros(5)))
"""


def slow_bus(**options):
    return Task(vehicles.load("van_real"), Delay(0.118, 0.106, 0.130), actuator="bars", **options)


@pytest.fixture(params=["file", "python"])
def own(request, tmp_path, monkeypatch):
    """Name of the law and its task, with the same gains from a file and in Python."""
    if request.param == "file":
        path = tmp_path / "gains.toml"
        path.write_text(f"K = [{GAINS}]\n")
        return "custom", slow_bus(matrices=str(path), feedforward=False)
    (tmp_path / "own.py").write_text(PYTHON)
    monkeypatch.setattr(LAWS, "_loaded", dict(LAWS._loaded))
    return f"{tmp_path}/own.py:law", slow_bus()


def test_it_is_refused_with_the_reduction_that_passes(own, tmp_path):
    law, task = own
    with pytest.raises(VerdictError, match=r"gain margin is .* against 8 dB") as refused:
        design(law, task)
    told = re.search(r"reduce the gains by (\d+) dB, or .*--unverified", str(refused.value))
    assert told is not None
    factor = 10.0 ** (-float(told[1]) / 20.0)
    reduced = tmp_path / "reduced.toml"
    reduced.write_text(f"K = [{[factor * gain for gain in GAINS]}]\n")
    assert design("custom", slow_bus(matrices=str(reduced), feedforward=False)).is_verified


def test_unverified_it_is_written_as_given_with_what_it_fails(own, tmp_path):
    law, task = own
    answer = design(law, replace(task, unverified=True))
    np.testing.assert_array_equal(answer.controller.feedback[:2], GAINS)
    file = tmp_path / "calibration.toml"
    calibration_file.save(file, *calibrate(answer))
    loaded = calibration_file.load(file)
    assert not loaded.verified
    assert any("gain margin is" in text for text in loaded.tables["design"]["failed"])
    assert loaded.warnings[0].startswith("NOT VERIFIED: ")
    assert "gain margin is" in loaded.warnings[0]


def test_a_law_takes_the_options_that_it_declares(tmp_path, monkeypatch):
    monkeypatch.setattr(LAWS, "_loaded", dict(LAWS._loaded))
    plain, sharing = PYTHON, PYTHON.replace("def law", "@declared.law(share=True)\ndef law")
    for name, text in (("plain", plain), ("sharing", sharing)):
        (tmp_path / f"{name}.py").write_text("from canroll.gain_gen.laws import declared\n" + text)
    task = slow_bus(moment_share=0.3, unverified=True)
    with pytest.raises(CanrollError, match="--moment-share applies to steering_lead, lqg_delay"):
        design(f"{tmp_path}/plain.py:law", task)
    assert design(f"{tmp_path}/sharing.py:law", task).task.moment_share == 0.3


@pytest.mark.parametrize("options", [{"shares": True}, {"feedforward": "both"}])
def test_a_law_cannot_declare_what_there_is_not(options):
    with pytest.raises(CanrollError):
        declared.law(**options)


def test_the_matrices_are_shown_as_given(tmp_path):
    path = tmp_path / "pd.toml"
    path.write_text(
        "A = [[0.6065]]\nB = [[1.0, 0.0, 0.0, 0.0]]\n"
        "C = [[-360.0]]\nD = [[-9000.0, -2700.0, 0.0, 0.0]]\n"
    )
    task = Task(vehicles.load("van_real"), Delay.constant(0.0144), actuator="bars")
    shown = summary(design("custom", replace(task, matrices=str(path))))["matrices"]
    assert shown["C"] == [[-360.0]]
    assert shown["D"] == [[-9000.0, -2700.0, 0.0, 0.0]]
