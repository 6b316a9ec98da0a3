"""The report page, as a browser without a network sees it."""

import base64
import html
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from types import SimpleNamespace

import numpy as np
import pytest
from support.chromium import ON_A_PHONE, shown

from canroll.hil.timing import histogram as time_histogram
from canroll.hil.timing import quantiles
from canroll.plant_sim.driving.standards import Verdict
from canroll.report.figure import Series, distribution, histogram, thin
from canroll.report.page import Cell, Page, PageTable, PageVerdict, render
from canroll.report.run_page import name_and_note, run_page, timing_figures, verdict
from canroll.report.tables import reaction_tables
from canroll.runs import experiment
from canroll.runs.standard import Standard, StandardJudgement


@pytest.fixture(scope="module")
def result():
    return experiment.run("double_lane_change", law="lqr", bus="gateway_20ms")


@pytest.fixture(scope="module")
def page(result):
    return run_page(result)


def test_moments_do_not_stand_in_a_column_of_times(result):
    times, moments = reaction_tables(result)
    assert times.head[1:] == ("from (s)", "to (s)")
    assert all(str(row[0]).startswith(("mode ", "fault code ")) for row in times.rows)
    assert moments.head[1:] == ("largest (N·m)", "longest over 500 N·m (s)")
    wanted = ["reaction.wrong_side_max_nm", "reaction.wrong_side_s"]
    assert [cell.key for cell in moments.rows[0][1:]] == wanted


def test_a_time_of_a_millisecond_is_not_rounded_away(result):
    short = replace(result.reaction, wrong_side_max_nm=518.0, wrong_side_s=0.001)
    _, moments = reaction_tables(SimpleNamespace(reaction=short))
    assert [cell.text for cell in moments.rows[0][1:]] == ["518", "0.001"]


@pytest.mark.parametrize(
    ("title", "parts"),
    [
        ("Laden panel van, complete and plausible data", ("Laden panel van", "complete and pl")),
        ("golf, based on van_real", ("golf", "based on van_real")),
        ("Van of a paper (Redondo, Boada, Díaz 2021)", ("Van of a paper (Redondo, Bo", "")),
        ("Car (Vu 2020), made possible, fitted", ("Car (Vu 2020)", "made possible, fitted")),
        ("Van (2 t, red", ("Van (2 t", "red")),
    ],
)
def test_a_note_is_no_part_of_the_headline(title, parts):
    name, note = name_and_note(title)
    assert name.startswith(parts[0]) and note.startswith(parts[1])
    assert title == (f"{name}, {note}" if note else name)


@pytest.mark.parametrize(
    ("passive", "controlled", "words"),
    [
        (True, True, "x: met with control and without control."),
        (False, True, "x: met with control, not met without control."),
        (False, False, "x: not met with control and without control."),
    ],
)
def test_the_verdict_has_that_of_the_standard(result, passive, controlled, words):
    judged = [
        StandardJudgement((Verdict("c", "4", 0.0, 0.0, "", passed),))
        for passed in (passive, controlled)
    ]
    assert verdict(replace(result, standard=Standard("x", *judged))).text.endswith(words)


@pytest.fixture(scope="module")
def path(page, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_text(page, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def document(path):
    """Return the page's document after its scripts ran without an error."""
    with shown(path) as browser:
        return browser.ask("document.documentElement.outerHTML")


class Numbers(HTMLParser):
    """Collects the table cells that say where in the JSON they come from."""

    def __init__(self, text):
        super().__init__()
        self.found = {}
        self._key = None
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        self._key = attrs.get("data-key")
        if self._key:
            self.found[self._key] = (float(attrs["data-value"]), "")

    def handle_data(self, data):
        if self._key:
            self.found[self._key] = (self.found[self._key][0], data)
            self._key = None


def lookup(data, key):
    for part in key.split("."):
        data = data[int(part) if isinstance(data, list) else part]
    return data


def test_every_number_in_the_tables_is_that_of_the_json(page, result):
    embedded = re.search(r'id="result">(.*?)</script>', page).group(1)
    data = json.loads(embedded)
    assert data == json.loads(json.dumps(result.to_json()))
    numbers = Numbers(page).found
    assert len(numbers) > 40
    for key, (value, text) in numbers.items():
        assert value == lookup(data, key), key
        assert float(text.replace("−", "-")) == pytest.approx(value, abs=0.5 + 1e-9), key


def test_the_page_needs_nothing_from_outside(page):
    assert not re.search(r"""(src|href)=["']?(https?:)?//""", page)
    assert "@import" not in page and "url(http" not in page


def test_verdict_comes_first_then_curves_and_the_bus_at_the_foot(page, result):
    parts = (
        *('class="verdict', '<div class="grid" data-figures="overview"', "<h2>Figures", "<h2>Bus"),
        *("<h3>Times on the bus", "<h3>Modes and fault codes", "<h2>Parameters", "<h2>Provenance"),
    )
    order = [page.index(text) for text in parts]
    assert order == sorted(order)
    assert result.settings.vehicle.basis in page


def test_every_number_of_the_vehicle_stands_with_its_source(page, result):
    vehicle = result.settings.vehicle
    source = html.escape(vehicle.source("plant.sprung_mass"))
    row = f"<td>vehicle: plant.sprung_mass</td><td>{vehicle.plant.sprung_mass:.6g}; {source}</td>"
    assert row in page
    assert "vehicle: sensors.speed.latency</td>" in page


def test_names_cannot_break_out_of_the_page(result):
    warned = replace(result, warnings=("</script><b>bold</b>",))
    text = run_page(warned)
    assert "<b>bold</b>" not in text


def test_every_plot_is_drawn(document):
    assert 'data-ready="true"' in document
    points = re.findall(r'<figure[^>]*id="figure-([\w-]+)"[^>]*data-points="(\d+)"', document)
    points += re.findall(r'<figure[^>]*data-points="(\d+)"[^>]*id="figure-([\w-]+)"', document)
    drawn = dict(points)
    expected = {
        "roll", "roll-rate", "nlt-front", "nlt-rear", "ay", "steer", "path-error", "path",
        "moment", "forces", "loads-front", "loads-rear", "estimate", "estimate-rate", "estimate-ay",
        "bus-load", "response", "age",
    }  # fmt: skip
    assert set(drawn) == expected
    top = document.partition('data-figures="overview"')[2].partition("<h2>")[0]
    assert re.findall(r'id="figure-([\w-]+)"', top) == ["roll", "moment", "ay"]
    assert all(int(count) > 0 for count in drawn.values()), drawn
    assert int(drawn["roll"]) > 400


def test_cones_stand_on_the_path(page, result):
    data = json.loads(re.search(r'id="data">(.*?)</script>', page, re.S).group(1))
    figure = next(figure for figure in data["figures"] if figure["id"] == "path")
    cones = next(series for series in figure["series"] if series["name"] == "cones")
    x, y = (np.frombuffer(base64.b64decode(cones[axis]), "<f4") for axis in "xy")
    # ISO 3888-1: the first gate stands after the approach, 1.1 times the width and 0.25 m wide
    width = 1.1 * result.settings.vehicle.geometry.width + 0.25
    assert sorted(y[x == x.min()]) == pytest.approx([-width / 2, width / 2])
    assert len(data["playback"]["cones"]) == len(x)


@pytest.fixture
def opened(path):
    """Return the page in a browser that is driven as people drive it."""
    with shown(path) as browser:
        yield browser


def legend(browser, figure="roll"):
    """Return the texts of a legend: the instant, then every curve with its value."""
    text = browser.ask(
        f"""[...document.querySelectorAll("#figure-{figure} .legend > *")].map(
          (item) => item.textContent)"""
    )
    return [text[-1], *text[:-1]]


def shown_points(browser, figure="roll"):
    return int(browser.ask(f"document.getElementById('figure-{figure}').dataset.points"))


def is_zoomed(browser, figure):
    return browser.ask(f"document.getElementById('figure-{figure}').classList.contains('zoomed')")


def test_the_cursor_shows_the_values_of_all_plots_at_one_instant(opened, result):
    opened.hover("#figure-roll .u-over")
    instant, passive, controlled = legend(opened)
    t = float(instant.split()[0])
    for text, run in ((passive, result.passive), (controlled, result.controlled)):
        value = float(re.search(r"control(-?[\d.]+)$", text)[1])
        wanted = np.degrees(np.interp(t, run.signals["time"], run.signals["roll"]))
        assert value == pytest.approx(wanted, abs=0.02)
    assert legend(opened, "steer")[0] == instant
    # the playback follows the cursor
    clock = opened.ask("document.querySelector('.playback .controls span').textContent")
    assert float(clock.split()[0]) == pytest.approx(t, abs=0.006)


def test_a_drag_zooms_every_plot_over_time_and_a_double_click_resets(opened):
    every = shown_points(opened)
    opened.drag("#figure-roll .u-over", 0.4, 0.6)
    assert is_zoomed(opened, "roll") and is_zoomed(opened, "moment")
    assert not is_zoomed(opened, "path")
    assert shown_points(opened) == pytest.approx(0.2 * every, rel=0.05)
    opened.click("#figure-roll .u-over", times=2)
    assert not is_zoomed(opened, "roll")
    assert shown_points(opened) == every


def test_a_map_is_zoomed_both_ways_and_alone(opened):
    opened.drag("#figure-path .u-over", 0.4, 0.6)
    assert is_zoomed(opened, "path") and not is_zoomed(opened, "roll")


def test_a_name_in_the_legend_switches_its_curve(opened):
    every = shown_points(opened)
    opened.click("#figure-roll .legend button")
    assert shown_points(opened) == pytest.approx(every / 2, rel=0.05)
    opened.click("#figure-roll .legend button")
    assert shown_points(opened) == every


def test_the_playback_plays(opened):
    opened.click(".playback .controls button")
    opened.wait_for(
        "document.querySelector('.playback .controls button').textContent.includes('pause')"
    )


WIDTHS = """({
  page: document.documentElement.scrollWidth,
  tables: [...document.querySelectorAll(".scroll")].map(
    (box) => [box.scrollWidth, box.clientWidth]),
})"""


def test_a_phone_shows_every_column(path):
    with shown(path, ON_A_PHONE) as browser:
        found = browser.ask(WIDTHS)
    assert found["page"] <= 390
    assert len(found["tables"]) >= 4
    assert all(content <= width for content, width in found["tables"]), found["tables"]


def test_rows_stack_under_a_head_too_wide_for_a_phone(tmp_path):
    head = [f"quantity {place} (N·m)" for place in range(12)]
    wide = PageTable("Wide", head, [["law", *(Cell("1234.5", 1234.5, "") for _ in head[1:])]])
    page = render(Page("t", "s", PageVerdict(None, "h", ""), (), [wide], (), None, (), ()))
    (tmp_path / "report.html").write_text(page, encoding="utf-8")
    with shown(tmp_path / "report.html", ON_A_PHONE) as browser:
        found = browser.ask(WIDTHS)
    assert all(content <= width for content, width in found["tables"]), found["tables"]
    assert 'data-label="quantity 11 (N·m)"' in page


def test_a_run_in_real_time_shows_its_timing(result):
    jitter, took = np.repeat([20_000, 50_000], [3, 1]), np.full(4, 170_500)
    nothing = np.array([], dtype=np.int64)
    times = {"start_jitter": jitter, "tick": took, "latency": nothing, "plant_jitter": took}
    told = {f"{name}_us": quantiles(values) for name, values in times.items()}
    timing = told | {
        "plant_step_us": quantiles(took),
        "ticks": 4,
        "pace": "realtime",
        "deadline_misses": 0,
        "frames_lost": 2,
        "notes": ["not pinned"],
        "histograms": {name: time_histogram(values) for name, values in times.items()},
    }
    page = run_page(replace(result, timing=timing))
    numbers = Numbers(page).found
    assert numbers["timing.start_jitter_us.max"] == (50.0, "50")
    assert numbers["timing.tick_us.p50"] == (170.5, "170")
    assert "timing.latency_us.max" not in numbers
    assert "4 ticks, 0 missed, 2 frames lost. not pinned" in page
    figures = {figure.id: figure for figure in timing_figures(timing)}
    assert set(figures) == {"timing-jitter", "timing-tick"}
    bars, plant = figures["timing-jitter"].series
    assert bars.y[0] == 75 and bars.y[-1] == 25 and bars.x[0] == 20
    assert plant.y.max() == 100


def test_the_playback_shows_the_largest_roll_angle_first(document, result):
    signals = result.passive.signals
    instant = signals["time"][np.argmax(np.abs(signals["roll"]))]
    shown = re.search(r'class="controls".*?<span[^>]*>([\d.]+) s</span>', document, re.S).group(1)
    assert float(shown) == pytest.approx(instant, abs=0.02)


def test_thinning_keeps_peaks():
    x = np.arange(100_000.0)
    y = np.sin(x / 9000)
    y[51_234] = 7.0
    thinned_x, thinned_y = thin(x, y, points=400)
    assert len(thinned_x) <= 402
    assert thinned_y.max() == 7.0 and thinned_x[0] == 0 and thinned_x[-1] == x[-1]


def test_histogram_and_distribution_count_everything():
    values = np.random.default_rng(0).normal(size=999)
    assert histogram("n", values, colour=0).y.sum() == pytest.approx(100)
    curve = distribution("n", values, colour=0)
    assert curve.x[0] == values.min() and curve.x[-1] == values.max() and curve.y[-1] == 100


def test_a_series_packs_to_float32():
    data = Series("n", np.arange(3), np.arange(3), 0).data()
    assert np.frombuffer(base64.b64decode(data["x"]), "<f4").tolist() == [0, 1, 2]
