"""The checker: it needs nothing of the project, and refuses what is not proved."""

import ast
import copy
import json
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import pytest

pytest.importorskip("flint")

from support.certificates import at, refusal, signed

from canroll.cli import main as cli
from canroll.extensions.certify import checker

SOURCE = Path(checker.__file__).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def certificate(certified):
    """Two conditions, each with two claims, the first with its level, and the roll model's."""
    content = json.loads(json.dumps(certified.content))
    names = ("every tick", "event trigger", "level")
    for condition in content["conditions"]:
        claims = [claim for claim in condition["claims"] if claim["name"] in names]
        condition["claims"] = sorted(claims, key=lambda claim: names.index(claim["name"]))
    assert [c["name"] for c in content["conditions"][0]["claims"]] == list(names)
    assert len(content["models"][0]["claims"]) == 3
    for of in content["conditions"]:
        content["proved"][of["name"]] = [claim["name"] for claim in of["claims"]]
    return signed(content)


def changed(content, path, change):
    """Return a copy in which the value at ``path`` is changed."""
    content = copy.deepcopy(content)
    node = at(content, path[:-1])
    node[path[-1]] = change(node[path[-1]])
    return content


def test_it_accepts_what_is_proved_and_names_it(certificate, integers):
    subject, *lines = checker.check(certificate, integers)
    assert len(lines) == 8
    assert "\nconditions: 2\nevent trigger: on, claimed in 2 of 2 conditions\n" in subject
    claimed = "proved: laden, 80 km/h: every tick: 2.4169 to 19.917 ms, roll_rad "
    assert lines[0].startswith(claimed)


def test_it_is_as_long_as_is_said_and_imports_nothing_of_the_project(capsys):
    tree, root = ast.parse(SOURCE), Path(checker.__file__).parents[3]
    assert 400 < len(SOURCE.splitlines()) <= 420
    with pytest.raises(SystemExit):
        cli.main(["certify", "--help"])
    for text in (
        capsys.readouterr().out,
        (root / "docs" / "certificate.md").read_text(encoding="utf-8"),
    ):
        assert "a checker of 420 lines" in " ".join(text.split())
    modules = {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
    modules |= {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
    assert {module.partition(".")[0] for module in modules} <= {*sys.stdlib_module_names, "flint"}


def test_it_says_what_it_takes():
    command = [sys.executable, "-I", checker.__file__, "certificate.json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr == "usage: python checker.py CERTIFICATE CALIBRATION\n"


def test_it_runs_alone_and_compares_the_integers(certificate, calibrated, tmp_path):
    (tmp_path / "check.py").write_text(SOURCE, encoding="utf-8")
    (tmp_path / "certificate.json").write_text(json.dumps(certificate), encoding="utf-8")
    other_file = calibrated("lqr").path

    def answer(calibration, file="certificate.json"):
        command = [sys.executable, "-I", "check.py", file, str(calibration)]
        done = subprocess.run(
            command, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False
        )
        return done.returncode, done.stdout

    calibration = calibrated("hinf_delay").path
    code, text = answer(calibration)
    assert code == 0
    assert text.splitlines()[-1] == (
        "valid: every claim is proved of the data above; that these are the vehicle's and the "
        "bus's is not checked"
    )
    assert answer(other_file) == (1, "not valid: ValueError: the calibration is another\n")
    older = certificate | {"format": "canroll certificate 4"}
    without = {key: value for key, value in certificate.items() if key != "source"}
    for contents in ("", "[1, 2]", "null", '{"format": 3', json.dumps(without), "\x00\n\n"):
        (tmp_path / "malformed.json").write_text(contents, encoding="utf-8")
        code, text = answer(calibration, "malformed.json")
        assert code == 1
        assert text.startswith("not valid: ")
        assert text.count("\n") == 1
    (tmp_path / "malformed.json").write_text(json.dumps(older), encoding="utf-8")
    words = "not valid: ValueError: its format is not 'canroll certificate 5'\n"
    assert answer(calibration, "malformed.json") == (1, words)


CLAIM = ("conditions", 1, "claims", 0)
TRIGGER = ("conditions", 1, "claims", 1)
LEVEL = ("conditions", 0, "claims", 2)
THEOREM = ("models", 0, "claims", 1)


def less(value):
    return str(Fraction(value) * Fraction(999, 1000))


def negated(value):
    return str(-Fraction(value))


@pytest.mark.parametrize(
    ("path", "change"),
    [
        ((*CLAIM, "roll_rad"), less),
        ((*CLAIM, "moment_nm"), less),
        ((*TRIGGER, "roll_rad"), less),
        ((*TRIGGER, "moment_nm"), less),
        ((*CLAIM, "decay"), lambda _: "1/2"),
        ((*CLAIM, "decay"), lambda _: "1"),
        ((*CLAIM, "slack"), lambda _: "0"),
        ((*CLAIM, "channels", 1, "cells"), lambda _: 2),
        ((*CLAIM, "channels", 1, "cells"), lambda _: 0),
        ((*CLAIM, "channels", 1, "cells"), lambda _: -1),
        ((*CLAIM, "weights", 0), lambda value: str(Fraction(value) / 10**6)),
        ((*CLAIM, "weights"), lambda weights: [*weights, weights[0]]),
        ((*TRIGGER, "name"), lambda _: "every tick"),
        ((*TRIGGER, "switching"), negated),
        ((*TRIGGER, "switching"), lambda value: str(10 * Fraction(value))),
        ((*TRIGGER, "weights", 0), lambda value: str(Fraction(value) / 10**6)),
        ((*TRIGGER, "weights", 0), negated),
        ((*LEVEL, "weights", -1), less),
        ((*LEVEL, "weights", -1), negated),
        ((*THEOREM, "gamma_squared"), less),
        ((*THEOREM, "gamma_squared"), negated),
        ((*THEOREM, "p", 0, 0), negated),
        ((*THEOREM, "r"), negated),
        ((*THEOREM, "r"), lambda _: "0"),
        ((*THEOREM, "omega"), lambda _: "0"),
        (("delay", 2), lambda _: "1"),
        (("models", 0, "flow", 1, 1), lambda _: "1"),
        (("models", 0, "performance", 0), lambda _: "9"),
        ((*CLAIM, "name"), lambda _: "event trigger"),
        ((*CLAIM, "name"), lambda _: "steered"),
        ((*CLAIM, "name"), lambda _: "-1 lost"),
        ((*CLAIM, "weights", 0), negated),
        (("delay", 1), lambda _: "1/5"),
        (("delay", 1), lambda _: "1/400"),
        (("delay", 0), lambda _: "-1/1000"),
        (("resolution", 0), lambda value: str(2 * int(value))),
        (("resolution", 4), negated),
        ((*CLAIM, "p", 0, 0), negated),
        ((*CLAIM, "p", 0, 1), less),
        ((*CLAIM, "p"), lambda rows: rows[:-1]),
        ((*CLAIM, "channels"), lambda channels: channels[:-1]),
        ((*CLAIM, "channels"), lambda channels: [*channels, channels[0]]),
        ((*CLAIM, "channels", 1, "weight"), negated),
        ((*CLAIM, "channels", 1, "weight"), lambda value: str(Fraction(value) / 10**6)),
        ((*CLAIM, "channels", 1, "centre", 0, 0), lambda value: str(Fraction(value) + 1)),
        ((*CLAIM, "channels", 1, "generators", 1, 1), lambda value: str(Fraction(value) + 1)),
        ((*CLAIM, "channels", 1, "onto", 0, 10), lambda value: str(Fraction(value) + 10**9)),
        (("conditions", 1, "speed"), lambda value: value + (1 << 20)),
        (("conditions", 1, "speed"), lambda value: -value),
        (("conditions", 1, "flow", 10, 13), lambda value: str(8 * Fraction(value))),
        (("conditions", 1, "flow", 2, 2), lambda _: "100"),
    ],
)
def test_mathematics_refuses_what_is_not_proved_with_the_right_digest(
    certificate, integers, path, change
):
    mutated = changed(certificate, path, change)
    assert mutated != certificate
    assert refusal(signed(mutated), integers)


@pytest.mark.parametrize(
    ("path", "change"),
    [
        (("output_gain", 0), lambda value: 8 * value),
        (("output_gain_shift",), lambda value: value - 3),
        (("trigger_epsilon_squared",), lambda _: 1 << 20),
        (("trigger_floor",), lambda value: 2 * value),
    ],
)
def test_mathematics_refuses_other_integers(certificate, integers, path, change):
    assert refusal(certificate, changed(integers, path, change))


def test_a_matrix_that_is_not_symmetric_proves_no_level():
    """Of a roll model without control the level is the peak of its frequency response."""
    frequencies = [0.001 * i for i in range(10_000)]
    peak = max(1.0 / abs(4.0 - w**2 + 0.8j * w) ** 2 for w in frequencies)
    c = {"law": 1, "output_gain": [0, 0, 0], "output_gain_shift": 13, "trigger_epsilon_squared": 0}
    model = {"flow": [["0", "1", "0", "0"], ["-4", "-4/5", "-1", "1"]], "performance": ["1", "0"]}
    claim = {"delay": ["0", "0"], "r": "1000", "omega": "1000"}
    claim |= {"trigger": False, "performance": True}

    def level(square, p):
        return checker.theorem(c, model, claim | {"gamma_squared": square, "p": p}, None)

    assert 0.1 < peak < 0.42
    level("21/50", [["13288/10000", "1307/10000"], ["1307/10000", "3322/10000"]])
    with pytest.raises(ValueError, match="the inequality does not hold"):
        level("1/10", [["2071/10000", "2588/10000"], ["-6342/10000", "3349/10000"]])


def test_positive_definite_matrices():
    assert checker.positive(checker.balls([["2", "1"], ["1", "2"]]))
    assert not checker.positive(checker.balls([["1", "1"], ["1", "1"]]))
    assert not checker.positive(checker.balls([["1", "2"], ["2", "1"]]))
    # a ball that touches zero decides nothing
    assert not checker.positive(checker.arb_mat([[checker.arb(1, 1)]]))
