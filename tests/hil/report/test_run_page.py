"""The report page, as a browser without a network sees it."""

import base64
import html
import json
import re
import shutil
import subprocess
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from hil.realtime.timing import histogram as time_histogram
from hil.realtime.timing import quantiles
from hil.report.figure import Series, distribution, histogram, thin
from hil.report.page import Cell, Page, Table, Verdict, render
from hil.report.run_page import run_page, timing_figures
from hil.runs import experiment

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-sync",
    "--disable-background-networking",
    "--disable-component-update",
    "--enable-logging=stderr",
    "--virtual-time-budget=2000",
    "--dump-dom",
]


@pytest.fixture(scope="module")
def result():
    return experiment.run("double_lane_change", law="lqr", bus="gateway_20ms")


@pytest.fixture(scope="module")
def page(result):
    return run_page(result)


USE = """<script>
SVGElement.prototype.setPointerCapture = () => {};
const found = {};
const figure = document.getElementById("figure-roll");
const svg = figure.querySelector(":scope > svg");
const at = (type, share) => {
  const box = svg.getBoundingClientRect();
  const x = box.left + box.width * share;
  const event = { clientX: x, clientY: box.top + 40, pointerId: 1, bubbles: true };
  svg.dispatchEvent(new PointerEvent(type, event));
};
at("pointermove", 0.5);
found.tip = figure.querySelector(".tip").textContent;
found.clock = document.querySelector(".controls span").textContent;
found.all = Number(figure.dataset.points);
at("pointerdown", 0.4);
at("pointermove", 0.6);
at("pointerup", 0.6);
found.zoomed = figure.classList.contains("zoomed");
found.linked = document.getElementById("figure-moment").classList.contains("zoomed");
found.apart = document.getElementById("figure-path").classList.contains("zoomed");
found.part = Number(figure.dataset.points);
svg.dispatchEvent(new MouseEvent("dblclick"));
found.reset = !figure.classList.contains("zoomed");
figure.querySelector(".legend button").click();
found.fewer = Number(figure.dataset.points);
document.querySelector(".controls button").click();
found.playing = document.querySelector(".controls button").textContent;
document.body.dataset.found = JSON.stringify(found);
</script></body>"""


@pytest.fixture(scope="module")
def browser(page, tmp_path_factory):
    """Return the page's document after its scripts ran, and what the console said."""
    return load(page, tmp_path_factory.mktemp("page"))


def load(page, folder, *flags):
    if CHROMIUM is None:
        pytest.skip("needs chromium")
    (folder / "report.html").write_text(page, encoding="utf-8")
    profile = f"--user-data-dir={folder / 'profile'}"
    process = subprocess.run(
        [CHROMIUM, *FLAGS, *flags, profile, f"file://{folder / 'report.html'}"],
        capture_output=True,
        text=True,
        timeout=1800,
        check=True,
    )
    return process.stdout, process.stderr


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


def test_verdict_comes_first_and_provenance_last(page, result):
    order = [page.index(text) for text in ('class="verdict', "<h2>Figures", "<h2>Provenance")]
    assert order == sorted(order)
    assert result.settings.vehicle.basis in page


def test_names_cannot_break_out_of_the_page(result):
    warned = replace(result, warnings=("</script><b>bold</b>",))
    text = run_page(warned)
    assert "<b>bold</b>" not in text


def test_loads_without_console_errors(browser):
    _, console = browser
    assert not [line for line in console.splitlines() if "CONSOLE" in line]


def test_every_plot_is_drawn(browser):
    document, _ = browser
    assert 'data-ready="true"' in document
    points = re.findall(r'<figure[^>]*id="figure-([\w-]+)"[^>]*data-points="(\d+)"', document)
    points += re.findall(r'<figure[^>]*data-points="(\d+)"[^>]*id="figure-([\w-]+)"', document)
    drawn = dict(points)
    expected = {
        "roll", "roll-rate", "nlt-front", "nlt-rear", "ay", "steer", "path-error", "path",
        "moment", "forces", "loads", "estimate", "estimate-rate", "estimate-ay",
        "bus-load", "response", "age",
    }  # fmt: skip
    assert set(drawn) == expected
    assert all(int(count) > 0 for count in drawn.values()), drawn
    assert int(drawn["roll"]) > 400


def test_plots_can_be_used(page, tmp_path):
    document, console = load(page.replace("</body>", USE), tmp_path)
    assert not [line for line in console.splitlines() if "CONSOLE" in line]
    text = re.search(r'data-found="(.*?)"', document).group(1)
    found = json.loads(html.unescape(text))
    assert "without control: " in found["tip"] and "with control: " in found["tip"]
    # the playback follows the cursor
    assert found["tip"].startswith(found["clock"].split()[0][:3])
    assert found["zoomed"] and found["linked"] and not found["apart"]
    assert 0 < found["part"] < found["all"]
    assert found["reset"]
    assert 0 < found["fewer"] < found["all"]
    assert "pause" in found["playing"]


WIDTHS = """<script>
// no window of a browser gets narrower than 500 pixels, its page does
document.body.style.width = "390px";
const found = { page: document.body.scrollWidth, tables: [] };
for (const box of document.querySelectorAll(".scroll")) {
  found.tables.push([box.scrollWidth, box.clientWidth]);
}
document.body.dataset.found = JSON.stringify(found);
</script></body>"""


def test_a_phone_shows_every_column(page, tmp_path):
    document, _ = load(page.replace("</body>", WIDTHS), tmp_path, "--window-size=500,800")
    found = json.loads(html.unescape(re.search(r'data-found="(.*?)"', document).group(1)))
    assert found["page"] <= 390
    assert len(found["tables"]) >= 4
    assert all(content <= width for content, width in found["tables"]), found["tables"]


def test_rows_stack_under_a_head_too_wide_for_a_phone(tmp_path):
    head = [f"quantity {place} (N·m)" for place in range(12)]
    wide = Table("Wide", head, [["law", *(Cell("1234.5", 1234.5, "") for _ in head[1:])]])
    page = render(Page("t", "s", Verdict(None, "h", ""), (), [wide], (), None, (), ())).replace(
        "</body>", WIDTHS
    )
    document, _ = load(page, tmp_path, "--window-size=500,800")
    found = json.loads(html.unescape(re.search(r'data-found="(.*?)"', document).group(1)))
    assert all(content <= width for content, width in found["tables"]), found["tables"]
    assert 'data-label="quantity 11 (N·m)"' in document


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


def test_the_playback_shows_the_largest_roll_angle_first(browser, result):
    document, _ = browser
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
