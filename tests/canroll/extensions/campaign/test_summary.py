"""The summary: quantiles to their accuracy, a fixed size, the order of draws without effect."""

import numpy as np
import pytest

from canroll.extensions.campaign import summary as summaries
from canroll.extensions.campaign.plan import SIDES
from canroll.extensions.campaign.summary import ACCURACY, Sketch, Summary
from canroll.runs.metrics import BY_KEY


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
def test_quantiles_have_their_accuracy(scale):
    values = scale * np.random.default_rng(0).lognormal(0.0, 2.0, 50_000)
    sketch = Sketch()
    for part in np.array_split(values, 7):
        sketch.add(part)
    shares = np.array([0.0, 0.01, 0.5, 0.99, 1.0])
    exact = np.quantile(values, shares, method="lower")
    assert sketch.quantiles(shares) == pytest.approx(exact, rel=1.01 * ACCURACY)
    assert tuple(sketch.quantiles(np.array([0.0, 1.0]))) == (values.min(), values.max())


def test_values_of_zero_are_zero():
    sketch = Sketch()
    sketch.add(np.array([0.0, 0.0, 5.0]))
    assert tuple(sketch.quantiles(np.array([0.0, 0.4, 1.0]))) == (0.0, 0.0, 5.0)


def rows(first, count):
    random = np.random.default_rng(first)
    found = {f"{side}_{name}": random.random(count) for side in SIDES for name in BY_KEY}
    for side in SIDES:
        found[f"{side}_rollover"] = np.zeros(count, dtype=bool)
    fails = random.random(count) < 0.5
    found["verdict"] = np.where(fails, "does not help", "helps").astype(object)
    return {"draw": np.arange(first, first + count), "cycle_nm": np.zeros(count), **found}


def test_its_size_does_not_depend_on_the_number_of_draws(monkeypatch):
    monkeypatch.setattr(summaries, "SAMPLE", 200)
    monkeypatch.setattr(summaries, "FAILED", 100)
    found = Summary()
    for chunk in range(40):
        found.add(rows(chunk * 50, 50))
    assert found.draws == 2000
    assert found.events["fails"] + found.verdicts["helps"] == 2000
    assert [len(part["draw"]) for part in (found.sample, found.failed, found.worst)] == [
        200,
        100,
        summaries.WORST,
    ]
    assert list(found.sample["draw"]) == list(range(200))
    assert not np.any(found.worst["verdict"] == "helps")
    less = summaries.reduction(found.worst)
    assert np.all(np.diff(less) >= 0)
