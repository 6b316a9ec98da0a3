"""Every number of a small certificate, changed and signed again: what passes must still be true.

Judged in floating point by the loop written anew from the file: matrix exponentials at delays
between the bounds, the command as one row. A changed number that only proves the same in another
way, such as one of the Lyapunov matrix, may pass.
"""

import copy
from fractions import Fraction

import numpy as np
import pytest

pytest.importorskip("flint")

from flint import fmpq
from scipy.linalg import expm
from support.certificates import (
    DELAY,
    RESOLUTION,
    TICK,
    at,
    floats,
    refusal,
    roll_model,
    signed,
)

from canroll import vehicles
from canroll.extensions.certify import checker
from canroll.extensions.certify.certificate import (
    EVERY_TICK,
    LEVEL,
    LOST,
    STEERED,
    TRIGGER,
    TRIGGER_LEVEL,
    state,
)
from canroll.extensions.certify.claim import MOMENT, Wish, prove
from canroll.extensions.certify.theorem import theorems

SOURCE = dict.fromkeys(checker.SOURCE, "of a test")
NAMES = {"name", "sha256", "format"}
CHANGES = {
    "one in the last place": lambda value: _number(value, lambda v: v + Fraction(1, v.denominator)),
    "one less": lambda value: _number(value, lambda v: v - Fraction(1, v.denominator)),
    "another sign": lambda value: _number(value, lambda v: -v),
    "a little": lambda value: _number(value, lambda v: v * Fraction(1001, 1000)),
    "a little less": lambda value: _number(value, lambda v: v * Fraction(999, 1000)),
}


def _number(value, change):
    """Return a changed number of the same kind; integers stay integers."""
    if isinstance(value, bool):
        return not value
    new = change(Fraction(value))
    return str(new) if isinstance(value, str) else round(new)


def certificate(conditions, models=()):
    content = {
        "format": checker.FORMAT,
        "source": SOURCE,
        "delay": [*map(str, DELAY), "1/500"],
        "resolution": RESOLUTION,
        "conditions": conditions,
        "models": list(models),
    }
    state(content)
    return content


@pytest.fixture(scope="module")
def coarse():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("canroll.extensions.certify.claim.CELLS", 64)
        yield


@pytest.fixture(scope="module")
def small(integers, coarse):
    """The roll model behind one delay, two claims."""
    condition = roll_model(80)
    for name, trigger in ((EVERY_TICK, False), (TRIGGER, True)):
        claim = prove(integers, condition, Wish(name, DELAY, RESOLUTION, trigger))
        condition["claims"].append(claim)
    assert all(condition["claims"])
    return certificate([condition])


@pytest.fixture(scope="module")
def several(integers, coarse):
    """Two conditions and the papers' inequalities, eight claims."""
    # at 7.5 km/h half of the gain has faded
    first, second = roll_model(80), roll_model(7.5)
    every, trigger = (
        Wish(name, DELAY, RESOLUTION, name == TRIGGER) for name in (EVERY_TICK, TRIGGER)
    )
    lost = Wish(LOST.format(1), (DELAY[0], DELAY[1] + TICK), RESOLUTION)
    first["claims"] = [prove(integers, first, wish) for wish in (every, trigger)]
    steered = Wish(STEERED, DELAY, RESOLUTION, limited=True, disturbances={MOMENT: 100.0})
    first["claims"].append(prove(integers, first, steered))
    second["claims"] = [prove(integers, second, wish) for wish in (every, lost)]
    assert all(first["claims"] + second["claims"])
    model = theorems(integers, vehicles.load("van_real").design, DELAY[1] + Fraction(1, 500) + TICK)
    assert len(model["claims"]) == 3
    return certificate([first, second], [model])


def nodes(node, path=()):
    """Yield all dictionaries and lists with their paths."""
    yield path, node
    for key, value in node.items() if isinstance(node, dict) else enumerate(node):
        if isinstance(value, dict | list):
            yield from nodes(value, (*path, key))


def kinds(content):
    """Yield one node of each kind, the last: of lists one entry."""
    last = {tuple(key for key in path if isinstance(key, str)): path for path, _ in nodes(content)}
    yield from ((path, at(content, path)) for path in last.values())


def replaced(content, path, new):
    """Return a copy with another entry at a path."""
    if not path:
        return new
    mutated = copy.deepcopy(content)
    at(mutated, path[:-1])[path[-1]] = new
    return mutated


def leaves(node, path=()):
    """Yield the paths to all numbers."""
    for key, value in node.items() if isinstance(node, dict) else enumerate(node):
        if isinstance(value, dict | list):
            yield from leaves(value, (*path, key))
        elif path[:1] not in {("source",), ("proved",)} and key not in NAMES:
            yield (*path, key)


def one(text):
    return float(Fraction(text))


def true(c, content, claim):
    """Whether V falls as claimed at delays between the bounds, and the bounds follow from it."""
    condition, p = content["conditions"][0], floats(claim["p"])
    claim = claim | checker.meant(content, condition, claim["name"], fmpq(1, 100))
    flow, n = floats(condition["flow"]), len(condition["flow"])
    a, b, tick = flow[:, :n], flow[:, n:], float(TICK)
    p = 0.5 * (p + p.T)
    off = [one(text) for text in claim["resolution"]]
    gains = np.array(c["output_gain"][:2]) / 2.0 ** c["output_gain_shift"]
    speed, points = condition["speed"], slice(c["schedule_points"])
    factor = np.interp(speed, c["schedule_speed"][points], c["schedule_gain"][points]) / 2.0**28
    factor *= np.interp(speed, (c["fade_low"], c["fade_high"]), (0.0, 1.0))
    law = factor * gains @ floats(condition["readings"])[:2]
    rounded = abs(factor) * (np.abs(gains) @ off[:2] + 0.5) + 0.5 + off[4]
    withheld = int(claim["trigger"])
    weights = np.array([one(text) for text in claim["weights"]])
    decay, moment = one(claim["decay"]), len(claim["disturbances"])
    # variables: car, command before, withheld part of the new one, its rounding, moment
    size = n + 1 + withheld + 1 + moment
    sent, before = np.zeros(size), np.eye(size)[n]
    sent[:n], sent[n + 1 : size - moment] = law, 1.0
    lost = np.diag(np.r_[np.zeros(n + 1), weights])
    if withheld:
        share = c["trigger_epsilon_squared"] / 2.0**20
        lost -= weights[0] * share * np.outer(sent, sent)
        kept = one(claim["switching"]) * np.outer(np.eye(size)[n + 1], sent - before)
        lost -= 0.5 * (kept + kept.T)
    if claim["performance"]:
        roll = np.r_[[one(text) for text in condition["roll"]], np.zeros(size - n)]
        lost -= np.outer(roll, roll)
    lost[: n + 1, : n + 1] += decay * p
    least, most = (one(text) for text in claim["delay"])

    def after(delay):
        def held(seconds):
            block = np.zeros((n + 2, n + 2))
            block[:n, :n], block[:n, n:] = a, b[:, :2]
            return expm(block * seconds)[:n]

        early, late = held(delay), held(tick - delay)
        plant = np.zeros((n, size))
        plant[:, :n] = late[:, :n] @ early[:, :n]
        plant += np.outer(late[:, :n] @ early[:, n], before) + np.outer(late[:, n], sent)
        if moment:
            plant[:, -1] = late[:, :n] @ early[:, n + 1] + late[:, n + 1]
        return np.vstack([plant, sent])

    scale = 1.0 / np.sqrt(np.r_[np.diag(p), np.abs(weights)])
    for delay in np.linspace(least, most, 9):
        form = lost - after(delay).T @ p @ after(delay)
        if np.linalg.eigvalsh(form * np.outer(scale, scale))[0] < -1e-9:
            return False
    if not 0.0 <= least <= most or most > tick or min(weights) < 0.0:
        return False
    spent = weights[withheld] * rounded**2 + withheld * weights[0] * c["trigger_floor"] ** 2
    level = np.sqrt(spent / (1.0 - decay))
    inverse = np.linalg.inv(p)

    def reach(row):
        return level * np.sqrt(row @ inverse @ row)

    roll = np.r_[[one(text) for text in condition["roll"]], 0.0]
    return (
        reach(roll) <= (1.0 + 1e-9) * one(claim["roll_rad"])
        and (reach(np.r_[law, 0.0]) + rounded) / 2**14 <= (1.0 + 1e-9) * one(claim["moment_nm"])
        and all(one(each["most"]) >= 0.0 for each in claim["disturbances"])
    )


@pytest.mark.slow
def test_what_passes_after_a_change_is_true(small, integers):
    assert refusal(small, integers) == ""
    assert all(true(integers, small, claim) for claim in small["conditions"][0]["claims"])
    passed, refused = set(), set()
    for path in leaves(small):
        for name, change in CHANGES.items():
            mutated = copy.deepcopy(small)
            node = at(mutated, path[:-1])
            node[path[-1]] = change(node[path[-1]])
            if mutated == small:
                continue
            assert refusal(mutated, integers), (path, name)
            condition = mutated["conditions"][0]
            # only what the number touches
            if "claims" in path:
                condition["claims"] = [condition["claims"][path[3]]]
                mutated["proved"] = {condition["name"]: [condition["claims"][0]["name"]]}
            if refusal(signed(mutated), integers):
                refused.add((path, name))
                continue
            passed.add((path, name))
            for claim in condition["claims"]:
                assert true(integers, mutated, claim), (path, name)
    assert len(passed) + len(refused) > 500
    assert len(refused) > 200
    for number in (0, 1):
        for bound in ("roll_rad", "moment_nm"):
            path = ("conditions", 0, "claims", number, bound)
            assert {(path, "a little less"), (path, "another sign")} <= refused


def test_nothing_may_be_missing(several, integers):
    """Any key left out, any list emptied, signed again."""
    assert refusal(several, integers) == ""
    tried = 0
    for path, node in kinds(several):
        if isinstance(node, dict):
            changes = [{key: value for key, value in node.items() if key != left} for left in node]
        else:
            changes = [[]] * bool(node)
        for change in changes:
            mutated = replaced(several, path, change)
            if "sha256" in mutated:
                signed(mutated)
            assert refusal(mutated, integers), (path, node)
            tried += 1
    assert tried > 60


def test_a_disturbance_is_one_of_the_three_inputs(several, integers):
    for wrong in (-1, 3):
        mutated = copy.deepcopy(several)
        mutated["conditions"][0]["driven"][0]["input"] = wrong
        assert refusal(signed(mutated), integers)


@pytest.mark.parametrize("wrong", [None, 1.5, "12", {}, [[]]])
def test_an_entry_of_another_type_is_refused(several, integers, wrong):
    for path, node in kinds(several):
        for key in node if isinstance(node, dict) else [0] * bool(node):
            if (*path, key) == ("sha256",) or path[:1] == ("source",):
                continue
            # a number may well be another one; a text is no list of its characters
            if wrong != "12" or not isinstance(node[key], str):
                mutated = replaced(several, (*path, key), wrong)
                assert refusal(signed(mutated), integers), path


@pytest.mark.slow
def test_a_claim_has_no_other_name_or_data(several, integers):
    """Renamed alone, and with the statement; data exchanged between any two claims."""
    every = several["conditions"] + several["models"]
    places = [(i, j) for i, of in enumerate(every) for j in range(len(of["claims"]))]
    names = {claim["name"] for of in every for claim in of["claims"]}
    names |= {LEVEL, TRIGGER_LEVEL, "2 lost", "-1 lost", "0.5 lost", "stable", ""}

    def copied():
        mutated = copy.deepcopy(several)
        return mutated, mutated["conditions"] + mutated["models"]

    passed = set()
    for i, j in places:
        for name in names - {every[i]["claims"][j]["name"]}:
            mutated, changed = copied()
            changed[i]["claims"][j]["name"] = name
            assert refusal(signed(mutated), integers), (i, j, name)
            mutated["proved"][changed[i]["name"]][j] = name
            if not refusal(signed(mutated), integers):
                passed.add((every[i]["name"], every[i]["claims"][j]["name"], name))
    # what holds with the trigger holds without it, and the matrix under bounded inputs has a level
    true_as_well = {(every[2]["name"], "level with event trigger", "level")}
    assert passed <= true_as_well | {(every[0]["name"], "steered", "level")}
    for one_place in places:
        for other in places:
            if one_place < other:
                mutated, changed = copied()
                (i, j), (k, m) = one_place, other
                a, b = changed[i]["claims"][j], changed[k]["claims"][m]
                changed[i]["claims"][j] = b | {"name": a["name"]}
                changed[k]["claims"][m] = a | {"name": b["name"]}
                assert refusal(signed(mutated), integers), (one_place, other)


def test_fewer_conditions_or_claims_are_not_what_is_stated(several, integers):
    for change in (
        lambda content: content["conditions"].pop(),
        lambda content: content["models"].pop(),
        lambda content: content["conditions"][0]["claims"].pop(),
        lambda content: content["conditions"].append(content["conditions"][0]),
        lambda content: content["conditions"][1].update(name=content["conditions"][0]["name"]),
        lambda content: content.update(conditions=[], models=[], proved={}),
    ):
        mutated = copy.deepcopy(several)
        change(mutated)
        assert refusal(signed(mutated), integers)
