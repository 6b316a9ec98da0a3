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

from scipy.linalg import expm

import vehicles
from gain_gen.analysis.actuated_car import actuated, roll_car
from gain_gen.certificate import checker
from gain_gen.certificate.certificate import EVERY_TICK, INTEGERS, TRIGGER
from gain_gen.certificate.claim import Wish, prove, texts

TICK, DELAY = 0.01, (0.004, 0.008)
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


@pytest.fixture(scope="module")
def small(calibrated):
    """The roll model with actuator and sensors behind one delay, two claims."""
    record = calibrated("hinf_delay").record
    integers = {name: getattr(record, name) for name in INTEGERS}
    vehicle = vehicles.load("van_real")
    car = actuated(roll_car(vehicle.design), lag=0.02, sensors=vehicle.sensors)
    condition = {
        "name": "roll model",
        "speed": 0.0,
        "gain_factor": 1 << 28,
        "a": texts(car.a),
        "b": texts(np.hstack([car.command / (1 << 14), car.disturbance, *[0 * car.command] * 2])),
        "readings": texts(car.measured[[0, 1, 3]]),
        "roll": texts(car.measured[2]),
        "claims": [],
    }
    wishes = [
        Wish(name, DELAY, ["6000", "21000", "9000", "16000", "16000"], trigger)
        for name, trigger in ((EVERY_TICK, False), (TRIGGER, True))
    ]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gain_gen.certificate.claim.CELLS", 64)
        claims = [prove(integers, condition, wish) for wish in wishes]
    assert all(claims)
    condition["claims"] = claims
    return signed({"integers": integers, "conditions": [condition], "models": []})


def signed(content):
    content["sha256"] = checker.digest(content)
    return content


def leaves(node, path=()):
    """Yield the paths to all numbers."""
    for key, value in node.items() if isinstance(node, dict) else enumerate(node):
        if isinstance(value, dict | list):
            yield from leaves(value, (*path, key))
        elif key not in {"name", "sha256"}:
            yield (*path, key)


def floats(rows):
    return np.array([[float(Fraction(text)) for text in row] for row in rows])


def one(text):
    return float(Fraction(text))


def true(c, condition, claim):
    """Whether V falls as claimed at delays between the bounds, and the bounds follow from it."""
    a, b, p = floats(condition["a"]), floats(condition["b"]), floats(claim["p"])
    p, n = 0.5 * (p + p.T), len(a)
    off = [one(text) for text in claim["resolution"]]
    gains = np.array(c["output_gain"][:2]) / 2.0 ** c["output_gain_shift"]
    factor = condition["gain_factor"] / 2.0**28
    readings = floats(condition["readings"])[:2] * np.array([[2.0**27], [2.0**24]])
    law = factor * gains @ readings
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

        early, late = held(delay), held(TICK - delay)
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
    if not 0.0 <= least <= most or most > TICK or min(weights) < 0.0:
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


def test_what_passes_after_a_change_is_true(small):
    assert checker.check(small) == ""
    condition = small["conditions"][0]
    assert all(true(small["integers"], condition, claim) for claim in condition["claims"])
    passed, refused = set(), set()
    for path in leaves(small):
        for name, change in CHANGES.items():
            mutated = copy.deepcopy(small)
            node = mutated
            for key in path[:-1]:
                node = node[key]
            node[path[-1]] = change(node[path[-1]])
            if mutated == small:
                continue
            assert checker.check(mutated), (path, name)
            if path[0] == "integers":  # those of the calibration decide
                assert checker.check(signed(mutated), small["integers"]), (path, name)
                continue
            condition = mutated["conditions"][0]
            # only what the number touches
            if "claims" in path:
                condition["claims"] = [condition["claims"][path[3]]]
            if checker.check(signed(mutated)):
                refused.add((path, name))
                continue
            passed.add((path, name))
            for claim in condition["claims"]:
                assert true(mutated["integers"], condition, claim), (path, name)
    assert len(passed) + len(refused) > 500
    assert len(refused) > 200
    for number in (0, 1):
        for bound in ("roll_rad", "moment_nm"):
            path = ("conditions", 0, "claims", number, bound)
            assert {(path, "a little less"), (path, "another sign")} <= refused
