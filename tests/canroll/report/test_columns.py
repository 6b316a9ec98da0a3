"""Recorded columns as the page unpacks them: in the browser, against what was packed."""

import json
from importlib.resources import files

import numpy as np
import pytest
from support.chromium import tab

from canroll.report.columns import STEPS, column, every, instants, payloads
from canroll.report.document import PLOTS


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "page.html"
    assets = files("canroll.report") / "assets"
    scripts = [(assets / name).read_text(encoding="utf-8") for name in (*PLOTS, "recorded.js")]
    path.write_text("".join(f"<script>{text}</script>" for text in scripts), encoding="utf-8")
    with tab() as opened:
        opened.open(f"file://{path}")
        yield opened


def unpacked(browser, packed):
    values = browser.ask(
        f"unpackedColumn({json.dumps(packed)}).then((v) => [...v].map((x) => isNaN(x) ? null : x))"
    )
    return np.array([np.nan if value is None else value for value in values])


@pytest.mark.parametrize(
    "values",
    [
        np.cumsum(np.random.default_rng(0).normal(size=3000)),
        np.random.default_rng(1).uniform(-1e7, 1e7, 2000),
        np.array([0.0, 1.0, 1.0, 0.0]),
        np.array([3.5] * 7),
        np.array([1.0, np.nan, -1.0, np.inf, 0.25]),
        np.array([-1e300, 1e300]),
        np.array([np.nan, np.nan]),
        np.array([]),
    ],
    ids=["walk", "noise", "flags", "constant", "gaps", "huge", "nothing", "empty"],
)
def test_a_column_comes_back_within_half_a_step(browser, values):
    found = unpacked(browser, column(values))
    known = np.isfinite(values)
    assert np.array_equal(np.isnan(found), ~known)
    if known.any():
        step = 2 * (values[known].max() / 2 - values[known].min() / 2) / STEPS
        assert np.all(np.abs(found[known] - values[known]) <= 0.51 * step)


def test_times_are_exact_to_the_microsecond(browser):
    times = np.cumsum(np.random.default_rng(2).integers(0, 5_000_000, 900)) * 1e-6
    assert times[-1] > 2000
    assert np.allclose(unpacked(browser, instants(times[times < 2000])), times[times < 2000])
    assert np.allclose(unpacked(browser, instants(times)), times, atol=0.51e-4)


def test_payloads_come_back(browser):
    rows = np.random.default_rng(3).integers(0, 256, (50, 8), dtype=np.uint8)
    stream = {"payload": payloads(rows), "width": 8, "time": instants(np.arange(50.0))}
    asked = f"""unpackedPayloads({json.dumps(stream)}).then(
      (bytes) => Array.from({{ length: 50 }}, (_, i) => [...bytes(i)]))"""
    assert browser.ask(asked) == rows.tolist()


def test_every_third_value_of_parts_is_that_of_the_array():
    values = np.arange(100.0)
    for cuts in ([7, 8, 50], [3], [1, 2, 99]):
        assert np.array_equal(every(np.split(values, cuts), 3), values[::3])


def test_the_same_values_give_the_same_text():
    values = np.sin(np.arange(1000.0))
    assert column(values) == column(values.copy())
