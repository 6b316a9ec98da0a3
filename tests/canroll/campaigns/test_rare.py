"""Subset simulation on problems of known probability, beside brute force, and over draws."""

import json

import numpy as np
import pytest
from scipy.special import ndtri

from canroll.campaigns.rare import estimate
from canroll.cli.main import main

PROBABILITY = 1e-3
BOUND = -ndtri(PROBABILITY)


def linear(name, points, seeds):
    """The sum of all scores beyond a bound."""
    scores = ndtri(points)
    return scores.sum(axis=1) / np.sqrt(scores.shape[1]) / BOUND


def either(name, points, seeds):
    """The first score beyond a bound on either side: two regions."""
    return np.abs(ndtri(points[:, 0])) / -ndtri(PROBABILITY / 2)


def noisy(name, points, seeds):
    """A third of the variance comes from the seed."""
    noise = np.array([np.random.default_rng(seed).standard_normal() for seed in seeds])
    return (np.sqrt(0.7) * ndtri(points[:, 0]) + np.sqrt(0.3) * noise) / BOUND


@pytest.mark.parametrize(("level", "dimensions"), [(linear, 2), (linear, 12), (either, 4)])
def test_it_covers_the_known_probability(level, dimensions):
    found = [estimate(level, dimensions, samples=300, seed=seed) for seed in range(60)]
    covered = [one.interval[0] <= PROBABILITY <= one.interval[1] for one in found]
    values = np.array([one.probability for one in found])
    assert np.mean(covered) >= 0.95
    assert values.mean() == pytest.approx(PROBABILITY, rel=0.25)
    assert values.std() / values.mean() < np.mean([one.variation for one in found])
    assert max(one.runs for one in found) < 0.02 / PROBABILITY * 100


def test_what_comes_from_noise_is_counted():
    found = [estimate(noisy, 2, samples=300, seed=seed) for seed in range(20)]
    assert np.mean([one.probability for one in found]) == pytest.approx(PROBABILITY, rel=0.4)


def test_it_agrees_with_brute_force():
    """Of 100 000 plain draws about 100 have the event; the interval holds their share."""
    points = np.random.default_rng(1).random((100_000, 3))
    share = np.mean(linear("", points, None) >= 1.0)
    low, high = estimate(linear, 3, samples=1000, seed=3).interval
    assert low <= share <= high


def test_an_event_that_is_not_rare_needs_one_level():
    found = estimate(lambda name, points, seeds: 2.0 * points[:, 0], 1, samples=500, seed=0)
    assert len(found.levels) == 1
    assert found.probability == pytest.approx(0.5, abs=0.08)
    assert found.runs == 500


def test_what_never_happens_has_no_probability():
    found = estimate(lambda name, points, seeds: np.zeros(len(points)), 1, samples=100, seed=0)
    assert found.probability == 0.0
    assert found.event is None


def test_draws_that_cannot_be_are_left_out():
    """Half of the draws cannot be: the probability is that among the others."""

    def level(name, points, seeds):
        return np.where(points[:, 0] < 0.5, -np.inf, points[:, 1] / 0.8)

    found = estimate(level, 2, samples=1000, seed=0)
    assert found.probability == pytest.approx(0.2, abs=0.04)


@pytest.mark.long
def test_samples_of_a_campaign_are_kept_and_seen_again(tmp_path, capsys):
    pytest.importorskip("pyarrow", reason="needs pyarrow: the extra campaign")
    options = ["campaign", "roundabout", "--plant", "roll1", "--law", "lqr", "--jobs", "1"]
    options += ["--rare", "harm", "--samples", "100", "--out", str(tmp_path), "--json"]
    options += ["--fault", "front=weak:0.2@1", "--spread", "speed=0.4"]
    assert main(options) == 0
    data = json.loads(capsys.readouterr().out)
    table = tmp_path / "campaign-harm.parquet"
    first = table.read_bytes()
    assert data["table"] == str(table)
    assert main([*options, "--resume"]) == 0
    assert json.loads(capsys.readouterr().out) == data
    assert table.read_bytes() == first
    assert main([*options, "--only", "7"]) in (0, 1)
    import pyarrow.parquet as pq

    rows = pq.read_table(table).to_pydict()
    alone = json.loads(capsys.readouterr().out)
    ratios = [
        alone["controlled"][key] / max(alone["passive"][key], least) / 1.1
        for key, least in (("roll_max_deg", 1.0), ("path_error_max_m", 0.05))
    ]
    assert rows["level"][rows["draw"].index(7)] == pytest.approx(max(ratios), rel=1e-15)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--rare", "fails"], "unknown --rare 'fails'"),
        (["--rare", "harm", "--samples", "55"], "a multiple of 10, got 55"),
        (["--rare", "harm", "--until", "0.1"], "--until: --rare draws level by level"),
        (["--rare", "harm", "--json", "--only", "1"], "add it"),
    ],
)
def test_what_cannot_be_is_one_line(capsys, options, message):
    arguments = ["campaign", "roundabout", "--plant", "roll1", "--law", "lqr", "--json", *options]
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
