"""The workbench of a run's page, used in a browser as people use it."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from cantools.database import DecodeError
from support.chromium import ON_A_PHONE, shown

from canroll import dbc
from canroll.plant_sim.can_bus.kernel.layout import DELIVERED
from canroll.report.curves import derived
from canroll.report.run_page import run_page
from canroll.report.workbench import FRAMES_MAX, INSTANTS_MAX, events, unit_of_command
from canroll.runs import experiment
from canroll.runs.trace import TICK
from canroll.vehicles.suspensions.tables import AxleTables, SteeringSystem, VehicleTables

pytestmark = pytest.mark.slow

DEGREES = float(np.degrees(1))


@pytest.fixture(scope="module")
def result():
    return experiment.run("double_lane_change", law="lqr", bus="gateway_20ms")


@pytest.fixture(scope="module")
def other():
    return experiment.run("double_lane_change", law="lqr", speed_kmh=60.0, duration=4.0)


@pytest.fixture(scope="module")
def path(result, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_text(run_page(result), encoding="utf-8")
    return path


@pytest.fixture
def opened(path):
    with shown(path) as browser:
        yield browser


def strips(browser):
    return browser.ask("[...document.querySelectorAll('.strip h3')].map((h) => h.textContent)")


def curves(browser, quantity):
    """Return the curves of a strip: x and y by the name of the run."""
    found = browser.ask(
        f"""bench.strips.get({json.dumps(quantity)}).series.map(
          ({{ name, x, y }}) => [name, [...x], [...y]])"""
    )
    return {name: (np.array(x), np.array(y)) for name, x, y in found}


def choose(browser, words, quantity):
    browser.write(".finder input[type=search]", words)
    browser.click(f".finder li:not([hidden]) input[value='{quantity}']")
    browser.wait_for(f"bench.strips.has({json.dumps(quantity)})")


def readings(browser):
    """Return the numbers of the table of cursors by the name of the row."""
    rows = browser.ask(
        """[...document.querySelectorAll(".readings tbody tr")].map(
          (row) => [...row.cells].map((cell) => cell.textContent))"""
    )
    return {name: [float(text) for text in numbers] for name, *numbers in rows}


def test_it_begins_with_roll_moment_and_acceleration(opened, result):
    assert strips(opened) == ["roll (deg)", "moment (N·m)", "ay (m/s²)"]
    for name, run in (("without control", result.passive), ("with control", result.controlled)):
        x, y = curves(opened, "roll")[name]
        assert np.allclose(x, run.signals["time"], atol=1e-6)
        assert np.allclose(y, DEGREES * run.signals["roll"], atol=1e-4)


def test_a_signal_is_searched_and_chosen(opened, result):
    choose(opened, "left wheel front load", "wheel_load_front_left")
    assert strips(opened)[-1] == "wheel load front left (N)"
    _, y = curves(opened, "wheel_load_front_left")["with control"]
    assert np.allclose(y, result.controlled.signals["wheel_load_front_left"], atol=0.5)
    listed = opened.ask("document.querySelectorAll('.finder li:not([hidden])').length")
    assert listed == 1
    opened.click("#strip-ay figcaption button[aria-label]")
    opened.wait_for("!bench.strips.has('ay')")
    assert "ay (m/s²)" not in strips(opened)


def test_signals_ticked_quickly_all_come(opened):
    boxes = "[...document.querySelectorAll('.finder li input')]"
    opened.ask(f"{boxes}.slice(0, 40).map((box) => box.click())")
    opened.ask("bench.queue.then(() => 1)")
    # two of them were there and go, the moment stays
    assert len(strips(opened)) == 39 and "x (m)" in strips(opened)
    opened.ask(f"[0, 0, 0].map(() => {boxes}[0].click())")
    opened.ask("bench.queue.then(() => 1)")
    assert "x (m)" not in strips(opened)
    ticked = opened.ask(f"{boxes}.filter((box) => box.checked).length")
    assert ticked == len(strips(opened)) == 38


def test_handling_signals_are_those_of_the_path_of_each_axle(opened, result):
    vehicle, signals = result.settings.vehicle, result.controlled.signals
    geometry = vehicle.geometry
    time, x, y, yaw, steer = (signals[name] for name in ("time", "x", "y", "yaw", "steer"))

    def course(ahead):
        along = np.gradient(x + ahead * np.cos(yaw), time)
        return np.arctan2(np.gradient(y + ahead * np.sin(yaw), time), along) - yaw

    front, rear = course(geometry.cg_to_front_axle), course(-geometry.cg_to_rear_axle)
    wanted = {
        "sideslip": course(0.0),
        "slip_angle_front": steer - front,
        "slip_angle_rear": -rear,
        "understeer_angle": steer - np.arctan(np.tan(front) - np.tan(rear)),
    }
    for name, angle in wanted.items():
        choose(opened, name.replace("_", " "), name)
        assert strips(opened)[-1] == f"{name.replace('_', ' ')} (deg)"
        _, found = curves(opened, name)["with control"]
        assert np.allclose(found[1:-1], DEGREES * angle[1:-1], atol=0.01)
        assert np.ptp(found) > 0.1
    choose(opened, "steering wheel", "steering_wheel_angle")
    _, wheel = curves(opened, "steering_wheel_angle")["with control"]
    _, sent = decoded(result.controlled, "VehicleMotion", "SteeringWheelAngle").T
    assert np.abs(wheel).max() == pytest.approx(np.abs(sent).max(), rel=0.03)


def test_no_slip_angles_where_tables_turn_the_wheels(result):
    vehicle = result.settings.vehicle
    turned = VehicleTables(front=AxleTables(steering_system=SteeringSystem(1.0, 1.0)))
    assert "slip_angle_rear" in derived(vehicle)
    assert not [name for name in derived(replace(vehicle, axles=turned)) if "slip_angle" in name]


@pytest.mark.parametrize(
    ("actuator", "message", "unit"),
    [
        ("bars", "AntiRollBarCommand", "N·m"),
        ("suspension", "SuspensionForceCommand", "N"),
        ("dampers", "DamperCommand", "mA"),
        ("dampers", "SuspensionForceCommand", "N"),
        ("valves", "ValveCommand", "mA"),
    ],
)
def test_a_demand_has_the_unit_of_its_command(actuator, message, unit):
    assert unit_of_command(actuator, message) == unit


@pytest.mark.parametrize("name", ["roll", "moment", "mode", "fault_codes", "gyro_bias"])
def test_what_the_ecu_computed_can_be_chosen(opened, result, name):
    choose(opened, f"ecu {name.replace('_', ' ')}", f"ecu.{name}")
    ticks = result.controlled.ticks
    _, y = curves(opened, f"ecu.{name}")["with control"]
    factor = DEGREES if name in ("roll", "gyro_bias") else 1.0
    assert np.allclose(y, factor * np.asarray(ticks[name], float), atol=0.02, rtol=1e-5)
    assert name in (TICK.names or ())


def decoded(run, name, field):
    """Return the times and values of a field by cantools, on the controller's segment."""
    message = dbc.load().get_message_by_name(name)
    chosen = [
        f
        for f in np.asarray(run.frames)
        if f["ident"] == message.frame_id and f["segment"] == 0 and f["outcome"] == DELIVERED
    ]
    found = []
    for f in sorted(chosen, key=lambda frame: frame["t_received"]):
        values = message.decode(f["payload"][: f["length"]].tobytes(), decode_choices=False)
        if field in values:
            found.append((f["t_received"] * 1e-9, values[field]))
    return np.array(found)


@pytest.mark.parametrize(
    ("name", "field"),
    [
        ("Imu", "RollRate"),
        ("Imu", "LateralAcceleration"),
        ("VehicleMotion", "VehicleSpeed"),
        ("RollControlStatus", "Mode"),
        ("RollControlDiagnostics", "ActiveFaultCodes"),
        ("AntiRollBarCommand", "Counter"),
    ],
)
def test_a_field_is_decoded_as_cantools_does(opened, result, name, field):
    choose(opened, f"{name}.{field}", f"{name}.{field}")
    wanted = decoded(result.controlled, name, field)
    x, y = curves(opened, f"{name}.{field}")["with control"]
    assert len(x) == len(wanted) > 0
    assert np.allclose(x, wanted[:, 0], atol=1e-6)
    assert np.allclose(y, wanted[:, 1])


def test_a_field_of_every_message_is_decoded_as_cantools_does(opened, result):
    """Random bytes, so that signs, byte orders and pages of multiplexed messages all occur."""
    payload = np.random.default_rng(0).integers(0, 256, (20, 8), dtype=np.uint8)
    for message in dbc.load().messages:
        for row in payload:
            data = row[: message.length]
            asked = f"""Object.fromEntries(Object.entries(fieldsOf(
              bench.book.messages["{message.frame_id:X}"], {data.tolist()}
            )).map(([name, {{ value }}]) => [name, value]))"""
            found = opened.ask(asked)
            try:
                wanted = message.decode(data.tobytes(), decode_choices=False)
            except DecodeError:
                continue  # a page that the message does not have
            assert found == pytest.approx(wanted), message.name


def test_two_cursors_show_values_and_differences(opened, result):
    opened.write("input[data-instant=A]", "2.5")
    opened.write("input[data-instant=B]", "3.75")
    rows = readings(opened)
    for name, run in (("without control", result.passive), ("with control", result.controlled)):
        time, roll = run.signals["time"], DEGREES * run.signals["roll"]
        a, b = np.interp([2.5, 3.75], time, roll)
        assert rows[f"roll (deg), {name}"] == pytest.approx([a, b, b - a], abs=0.003)
    assert opened.ask("document.querySelector('[data-cursors=difference]').textContent") == "1.250"
    assert opened.ask("document.querySelector('[data-cursors=rate]').textContent") == "0.800"


def test_clicks_place_one_cursor_after_the_other(opened):
    width = opened.ask("shared.window[1]")
    opened.click("#strip-roll .u-over", 0.25)
    opened.click("#strip-moment .u-over", 0.75)
    a, b = opened.ask("[bench.cursors.A, bench.cursors.B]")
    assert a == pytest.approx(0.25 * width, abs=0.02) and b == pytest.approx(0.75 * width, abs=0.02)
    opened.click("#strip-roll .u-over", 0.5)
    assert opened.ask("bench.cursors.A") == pytest.approx(0.5 * width, abs=0.02)
    opened.write("input[data-instant=A]", "3.75")
    opened.write("input[data-instant=B]", "2.5")
    assert opened.ask("document.querySelector('[data-cursors=rate]').textContent") == "0.800"


def test_a_drag_zooms_and_places_no_cursor(opened):
    before = opened.ask("[bench.cursors.A, bench.cursors.B]")
    opened.drag("#strip-roll .u-over", 0.2, 0.4)
    assert opened.ask("shared.range")[1] < opened.ask("shared.window[1]") / 2
    assert opened.ask("[bench.cursors.A, bench.cursors.B]") == before
    # the plots below show the same range, and all strips have their axes above each other
    assert opened.ask("document.getElementById('figure-steer').classList.contains('zoomed')")
    lefts = opened.ask("[...document.querySelectorAll('.strip .u-over')].map((o) => o.style.left)")
    assert len(set(lefts)) == 1


def test_the_address_keeps_what_is_chosen(opened, path):
    choose(opened, "Imu.RollRate", "Imu.RollRate")
    opened.drag("#strip-roll .u-over", 0.2, 0.4)
    opened.write("input[data-instant=A]", "1.5")
    opened.write("input[data-instant=B]", "2.0")
    opened.ask("document.querySelector('.frames select').value = '0'")
    opened.click(".frames input[type=checkbox]")
    state = "JSON.stringify([[...bench.strips.keys()], shared.range, bench.cursors, location.hash])"
    kept = json.loads(opened.ask(state))
    address = opened.ask("location.href")
    assert address != f"file://{path}"
    opened.call("Page.navigate", url="about:blank")
    opened.wait_for("location.href === 'about:blank'")
    opened.open(address)
    opened.wait_for("document.body.dataset.ready")
    chosen, shown, cursors, _ = json.loads(opened.ask(state))
    assert chosen == kept[0] and cursors == kept[2]
    assert shown == pytest.approx(kept[1], abs=1e-3)
    assert opened.ask("document.querySelector('.frames select').value") == "0"
    assert opened.ask("document.querySelector('.frames input').checked")


NO_RUN = "holds no recorded run: drop the report.html of a run"
DROP = """(async (name, text) => {
  const dropped = new DataTransfer();
  dropped.items.add(new File([text], name));
  const at = { dataTransfer: dropped, bubbles: true, cancelable: true };
  document.body.dispatchEvent(new DragEvent("drop", at));
  await new Promise((resolve) => setTimeout(resolve, 100));
  await bench.queue;
})"""


def drop(browser, name, text):
    browser.ask(f"{DROP}({json.dumps(name)}, {json.dumps(text)})")


def test_another_run_is_laid_over_by_dropping_its_page(opened, other, result):
    drop(opened, "report.html", run_page(other))
    opened.wait_for("bench.recordings.length === 4")
    opened.ask("bench.queue.then(() => 1)")
    found = curves(opened, "roll")
    assert list(found) == [
        "without control", "with control", "2: without control", "2: with control",
    ]  # fmt: skip
    x, y = found["2: with control"]
    assert np.allclose(x, other.controlled.signals["time"], atol=1e-6)
    assert np.allclose(y, DEGREES * other.controlled.signals["roll"], atol=1e-4)
    assert opened.ask("shared.window[1]") == pytest.approx(
        max(run.signals["time"][-1] for run in (result.passive, other.passive)), abs=1e-3
    )
    assert "at 60 km/h" in opened.ask("document.querySelector('.overlaid').textContent")
    opened.click(".overlaid button")
    opened.wait_for("bench.recordings.length === 2")
    opened.ask("bench.queue.then(() => 1)")
    assert list(curves(opened, "roll")) == ["without control", "with control"]


def test_a_run_can_be_chosen_as_a_file(opened, other, tmp_path):
    (tmp_path / "second.html").write_text(run_page(other), encoding="utf-8")
    node = opened.call("Runtime.evaluate", expression="document.querySelector('[type=file]')")
    opened.call(
        "DOM.setFileInputFiles",
        files=[str(tmp_path / "second.html")],
        objectId=node["result"]["objectId"],
    )
    opened.wait_for("bench.recordings.length === 4")
    opened.ask("bench.queue.then(() => 1)")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{}", NO_RUN),
        ('<script id="data">{"workb</script>', NO_RUN),
        ("<p>a page", NO_RUN),
        (
            '<script type="application/json" id="data">{"workbench":{"version":0}}</script>',
            "was written by another version of canroll: write it again with canroll run FOLDER",
        ),
    ],
)
def test_a_file_without_a_run_is_refused_by_name(opened, text, words):
    drop(opened, "result.json", text)
    assert opened.ask("document.querySelector('.message').textContent") == f"result.json {words}"
    assert opened.ask("bench.recordings.length") == 2


def frame_rows(browser):
    return browser.ask(
        """[...document.querySelectorAll(".frames tbody tr")].map(
          (row) => [...row.cells].map((cell) => cell.textContent).concat(row.className.trim()))"""
    )


def test_the_frames_around_the_cursor_are_listed(opened, result):
    opened.write("input[data-instant=A]", "3.0")
    opened.wait_for("bench.frameList.instant === 3")
    opened.wait_for(
        "document.querySelector('.frames tbody tr.here').cells[0].textContent[0] === '3'"
    )
    rows = frame_rows(opened)
    frames = np.asarray(result.controlled.frames)
    names = {m.frame_id: m.name for m in dbc.load().messages}
    known = frames[np.isin(frames["ident"], list(names))]
    known = known[np.argsort(known["t_received"], kind="stable")]
    middle = int(np.searchsorted(known["t_received"], 3_000_000_000, side="right"))
    wanted = known[middle - 12 : middle + 12]
    assert [row[0] for row in rows] == [f"{f['t_received'] * 1e-9:.4f}" for f in wanted]
    assert sorted(row[1:3] for row in rows) == sorted(
        [f"0x{f['ident']:X}", names[f["ident"]]] for f in wanted
    )
    assert [place for place, row in enumerate(rows) if row[-1] == "here"] == [12]
    assert any(re.search(r"RollRate -?\d+\.\d+ deg/s", row[3]) for row in rows)
    opened.click(".frames input[type=checkbox]")
    opened.wait_for(
        "document.querySelector('.frames tbody').textContent.includes('no description')"
    )


def test_modes_and_fault_codes_are_marked(result):
    marked = events(result.controlled.ticks)
    assert [(mark["t"], mark["text"]) for mark in marked] == [
        (change.t, change.mode) for change in result.reaction.modes
    ]
    ticks = np.zeros(4, TICK)
    ticks["t"], ticks["mode"] = [0.0, 0.01, 0.02, 0.03], [1, 1, 3, 3]
    ticks["fault_codes"] = [0, 0, 1, 0]
    assert [(mark["t"], mark["bad"]) for mark in events(ticks)] == [
        (0.0, False), (0.02, True), (0.02, True), (0.03, False),
    ]  # fmt: skip
    restless = np.zeros(2001, TICK)
    restless["fault_codes"] = np.arange(2001) % 2
    assert events(restless)[-1]["text"] == "1001 further changes left out"


def test_the_same_run_gives_the_same_page(result, path):
    assert run_page(result) == path.read_text(encoding="utf-8")


def test_a_run_without_control_has_a_workbench_too(tmp_path):
    alone = experiment.run("double_lane_change", law="passive", duration=2.0)
    (tmp_path / "report.html").write_text(run_page(alone), encoding="utf-8")
    with shown(tmp_path / "report.html") as browser:
        assert next(iter(curves(browser, "roll"))) == "without control"


def test_a_phone_shows_the_workbench(path):
    with shown(path, ON_A_PHONE) as browser:
        assert browser.ask("document.documentElement.scrollWidth") <= 390
        size = """getComputedStyle(document.querySelector("%s")).fontSize"""
        assert browser.ask(size % ".scroll td") == browser.ask(size % ".scroll + .soft")
        label = "[...document.querySelectorAll('.scroll table')[0].tBodies[0].rows]"
        # a label of the figures takes two lines of 1.5 times the letters at most
        heights = browser.ask(f"{label}.map((row) => row.cells[0].clientHeight)")
        assert max(heights) < 3 * 1.5 * 13.4
        height = "document.querySelector('.frames').clientHeight"
        assert browser.ask(height) < 50
        browser.click(".frames summary")
        assert browser.ask(height) > 1000
        assert browser.ask("document.documentElement.scrollWidth") <= 390


def test_an_old_browser_says_so_and_shows_the_plots(path):
    old = {"source": "delete globalThis.DecompressionStream"}
    calls = (("Page.enable", {}), ("Page.addScriptToEvaluateOnNewDocument", old))
    with shown(path, *calls) as browser:
        assert "cannot unpack" in browser.ask("document.querySelector('.message').textContent")
        assert browser.ask("document.querySelector('#figure-roll').dataset.points > 400")


def test_a_finger_zooms(path):
    touched = ("Emulation.setTouchEmulationEnabled", {"enabled": True})
    with shown(path, ON_A_PHONE, touched) as browser:
        left, top, width = browser.ask(
            """(() => {
              const over = document.querySelector("#strip-roll .u-over");
              over.scrollIntoView({ block: "center" });
              const box = over.getBoundingClientRect();
              return [box.left, box.top + box.height / 2, box.width];
            })()"""
        )
        for kind, share in (("Start", 0.3), ("Move", 0.4), ("Move", 0.5), ("Move", 0.6)):
            points = [{"x": left + share * width, "y": top}]
            browser.call("Input.dispatchTouchEvent", type=f"touch{kind}", touchPoints=points)
        browser.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
        browser.wait_for("shared.range")
        end = browser.ask("shared.window[1]")
        assert browser.ask("shared.range") == pytest.approx([0.3 * end, 0.6 * end], abs=0.05 * end)


def test_a_minute_of_everything_stays_under_ten_megabytes():
    long = experiment.run(
        "random_road", plant="nonlinear", bus="gateway_20ms", options={"duration": 60.0}
    )
    assert len(long.passive.frames) < FRAMES_MAX and INSTANTS_MAX >= 60_000 / 2
    assert len(run_page(long)) < 10e6
