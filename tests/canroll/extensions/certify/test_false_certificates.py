"""Certificates that say what is not so, correctly signed: they are refused, or show what they say.

Each was once accepted by the checker, with an answer that did not tell it from an honest one.
"""

import copy
import json
from fractions import Fraction

import pytest

pytest.importorskip("flint")

from support.certificates import refusal, signed

from canroll.extensions.certify import checker, comparison
from canroll.extensions.certify.certificate import EVERY_TICK, STEERED, TRIGGER, state
from canroll.extensions.certify.claim import MOMENT, Wish, prove
from canroll.extensions.certify.subject import subject
from canroll.gain_gen.margin_report import task_of


@pytest.fixture(scope="module")
def honest(certified):
    """One condition with its first three claims."""
    content = json.loads(json.dumps(certified.content))
    content["conditions"], content["models"] = content["conditions"][:1], []
    of = content["conditions"][0]
    names = (EVERY_TICK, TRIGGER, STEERED)
    of["claims"] = [claim for claim in of["claims"] if claim["name"] in names]
    content["proved"] = {of["name"]: [claim["name"] for claim in of["claims"]]}
    return signed(content)


def with_claims(content, wishes, integers):
    """A certificate of the first condition with other claims, proved for some integers."""
    content = copy.deepcopy(content)
    condition = content["conditions"][0]
    condition["claims"] = []
    condition["claims"] = [prove(integers, condition, wish) for wish in wishes]
    assert all(condition["claims"])
    state(content)
    return content


def wish_of(content, name=EVERY_TICK, **changes):
    delay = tuple(Fraction(text) for text in content["delay"][:2])
    return Wish(name, delay, content["resolution"], **changes)


def test_the_honest_one_is_accepted(honest, integers):
    subject, *claims = checker.check(honest, integers)
    assert len(claims) == 3
    assert "vehicle: 'van_real'\n" in subject
    assert f"vehicle_sha256: '{honest['source']['vehicle_sha256']}'\n" in subject
    assert "delays from sample to force: 2.4169 to 19.917 ms\n" in subject
    assert f"commands: {', '.join(honest['resolution'])}\n" in subject
    assert "steering angle (rad) up to 0." in claims[2]


def test_the_gain_is_that_of_the_schedule_at_the_speed(honest, integers):
    """Ten times the gain is unstable; of a gain of zero anything is proved."""
    loud = integers | {"output_gain": [10 * integers["output_gain"][0], 0, 0]}
    silent = loud | {"schedule_gain": [0] * 8}
    content = with_claims(honest, [wish_of(honest)], silent)
    content["conditions"][0]["gain_factor"] = 0
    assert refusal(signed(content), silent) == ""
    assert refusal(content, loud) == "the inequality does not hold"
    # at a speed at which the command has faded the name is another
    content["conditions"][0]["speed"] = 1
    assert "not that of its speed" in refusal(signed(content), loud)
    crawling = content["conditions"][0]
    crawling["speed"], crawling["name"] = round(4.0 / 3.6 * 2**20), "laden, 4 km/h"
    content["proved"] = {crawling["name"]: [EVERY_TICK]}
    assert list(checker.check(signed(content), loud))[1].startswith("proved: laden, 4 km/h: ")


@pytest.mark.parametrize(
    "other",
    [
        {"actuator": 2},
        {"actuator": 3},
        {"observer": 0},
        {"observer": 2},
        {"identification": 1},
        {"event_trigger": 0},
    ],
)
def test_another_loop_is_refused(honest, integers, other):
    assert "nother one" in refusal(honest, integers | other) or "no event trigger" in refusal(
        honest, integers | other
    )


def test_a_stage_of_its_own_is_refused(honest, calibrated, tmp_path):
    path = tmp_path / "calibration.toml"
    text = calibrated("hinf_delay").path.read_text(encoding="utf-8")
    path.write_text(text + '\n[stage]\nfile = "stage.py"\n', encoding="utf-8")
    content = copy.deepcopy(honest)
    content["source"]["calibration_sha256"] = checker.hashlib.sha256(path.read_bytes()).hexdigest()
    with pytest.raises(ValueError, match="a stage of its own"):
        checker.read(json.dumps(signed(content)).encode(), path.read_bytes())


@pytest.mark.parametrize(
    "name",
    [
        "laden, 80 km/h: every tick\nproved: laden, 80 km/h",
        "laden, 80 km/h: event trigger",
        "laden, 80 km/h\u2028",
        "laden, 80 km/h, curve of 4 m/s², friction 0.5\u202e",
        "laden, 80 km/h ",
        "laden, ８０ km/h",
        "",
    ],
)
def test_no_name_can_be_read_as_another(honest, integers, name):
    content = copy.deepcopy(honest)
    content["proved"] = {name: content["proved"].popitem()[1]}
    content["conditions"][0]["name"] = name
    assert "not that of its speed" in refusal(signed(content), integers)


def test_no_condition_passes_for_the_model_of_the_papers(honest, integers):
    """Its name would say no speed, at which all has faded."""
    content = copy.deepcopy(honest)
    content["models"], content["conditions"] = content["conditions"], []
    content["models"][0]["name"] = checker.MODEL
    content["proved"] = {checker.MODEL: content["proved"].popitem()[1]}
    assert "a model is none of the papers'" in refusal(signed(content), integers)


def test_no_text_of_the_source_makes_a_line(honest, integers):
    content = copy.deepcopy(honest)
    content["source"]["vehicle"] = "van_real\nproved: all of it"
    printed = next(checker.check(signed(content), integers))
    assert "\nproved" not in printed


def test_a_key_that_stands_twice_is_refused(honest, calibrated):
    text = json.dumps(honest)
    calibration = calibrated("hinf_delay").path.read_bytes()
    checker.read(text.encode(), calibration)
    for twice in ('{"delay": ["0", "1/2", "0"], ', '{"conditions": "ten", '):
        with pytest.raises(ValueError, match="a key stands twice"):
            checker.read(text.replace("{", twice, 1).encode(), calibration)


def test_an_easier_question_shows_in_the_answer(honest, integers):
    """A single delay, readings without steps, no steering: true, and told apart from the honest."""
    content = copy.deepcopy(honest)
    content["delay"][1] = content["delay"][0]
    content["resolution"] = ["0"] * 5
    nothing = wish_of(content, STEERED, limited=True, disturbances={MOMENT: 1e-6})
    content = with_claims(content, [wish_of(content), nothing], integers)
    subject, every, steered = checker.check(content, integers)
    assert "delays from sample to force: 2.4169 to 2.4170 ms" in subject
    assert "commands: 0, 0, 0, 0, 0\nconditions: 1\n" in subject
    assert "event trigger: on, claimed in 0 of 1 conditions" in subject
    assert every.startswith("proved: laden, 80 km/h: every tick: 2.4169 to 2.4170 ms, roll_rad ")
    assert "roll moment (N·m) up to 0.0000010000" in steered or "1.0000E-6" in steered


def test_a_question_of_any_size_is_refused_at_once(honest, integers):
    for change in (
        lambda content: content["conditions"][0]["claims"][0]["channels"][0].update(cells=10**12),
        lambda content: content.update(delay=[*content["delay"][:1], "100000", "0"]),
    ):
        content = copy.deepcopy(honest)
        change(content)
        assert refusal(signed(content), integers)


def test_the_comparison_finds_what_the_checker_takes_as_it_is(honest, calibrated):
    """With all conditions there, only what is changed differs."""
    calibration = calibrated("hinf_delay")
    task = task_of(calibration)

    def found(change):
        content = copy.deepcopy(honest)
        missing = subject(task, calibration)[1]
        content["conditions"] += missing["conditions"][1:]
        content["models"] = missing["models"]
        change(content)
        return [
            text
            for text in comparison.differences(content, task, calibration)
            if "there is no claim" not in text and not text.startswith("driven")
        ]

    assert found(lambda _: None) == []
    for change, words in (
        (lambda c: c.update(delay=["1/1000", *c["delay"][1:]]), "delay is [0.001, "),
        (
            lambda c: c.update(resolution=["0"] * 5),
            "resolution is [0.0, 0.0, 0.0, 0.0, 0.0], not [5867.0, ",
        ),
        (
            lambda c: c["conditions"].pop(),
            "empty, 80 km/h, curve of 3.2 m/s², friction 0.5: is ",
        ),
        (lambda c: c["conditions"][2].update(speed=1), "laden, 120 km/h: speed is another"),
        (lambda c: _slightly(c["conditions"][1]["flow"][3]), "laden, 40 km/h: flow is another"),
        (lambda c: _slightly(c["conditions"][0]["readings"][0]), "laden, 80 km/h: readings is an"),
        (lambda c: c["models"].pop(), "1-DOF roll model: is missing"),
        (lambda c: c["source"].update(vehicle="mine"), "vehicle is mine, not van_real"),
    ):
        (difference,) = found(change)
        assert difference.startswith(words)


def _slightly(row):
    number = next(i for i, text in enumerate(row) if Fraction(text))
    row[number] = str(Fraction(row[number]) * Fraction(1000001, 1000000))


def test_the_comparison_knows_the_bounds_of_steering(honest, calibrated):
    calibration = calibrated("hinf_delay")
    task = task_of(calibration)

    def of(change):
        content = copy.deepcopy(honest)
        # the claims of the others count for nothing here
        content["conditions"] = content["conditions"][:1]
        change(content["conditions"][0]["driven"])
        with pytest.MonkeyPatch.context() as patch:
            family, expected = subject(task, calibration)
            one = copy.copy(family)
            object.__setattr__(one, "members", family.members[:1])
            expected["conditions"], expected["models"] = expected["conditions"][:1], []
            patch.setattr(comparison, "subject", lambda *_: (one, expected))
            return list(comparison.differences(content, task, calibration))

    assert of(lambda _: None) == []
    (words,) = of(lambda driven: driven[1].update(most="1/1000000"))
    assert words.startswith("driven is not that of a steady lateral acceleration of 4, ")
    (words,) = of(lambda driven: driven.pop())
    assert words.startswith("driven is not that of")
