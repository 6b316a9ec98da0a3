"""FMUs of others as the plant: what fits is driven, what does not is refused in one line."""

import gc
import json
import os
import tempfile
from pathlib import Path

import numpy as np
import pytest
from fmpy.validation import validate_fmu
from support.foreign_fmu import write_fmu, write_map

from canroll.cli.main import main, parse
from canroll.errors import CanrollError
from canroll.extensions.exchange.cli import export_fmu
from canroll.plant_sim.bodies import body, own_body
from canroll.report.run_page import run_page
from canroll.runs.experiment import build_world, drive, plan, run

pytestmark = pytest.mark.slow


def children():
    """Process ids of this process's children."""
    return Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()


SHORT = {"duration": 2.2}


@pytest.fixture(scope="module")
def foreign(tmp_path_factory):
    """An FMU 2.0 of another tool."""
    return write_fmu(tmp_path_factory.mktemp("foreign") / "van.fmu")


@pytest.fixture
def mapped(foreign, tmp_path):
    """Name of that FMU with its map changed; the map is new for every test."""

    def name(**changes):
        return f"{foreign}#{write_map(tmp_path / 'map.toml', **changes)}"

    return name


def refusal(name, **choices):
    """Message of a run that is refused."""
    with pytest.raises(CanrollError) as error:
        run("double_lane_change", plant=name, **SHORT, **choices)
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.fixture(scope="module")
def result(foreign, tmp_path_factory):
    """A run of the foreign vehicle."""
    plant_map = write_map(tmp_path_factory.mktemp("map") / "van.toml")
    return run("double_lane_change", plant=f"{foreign}#{plant_map}", **SHORT)


BY_TABLES = """base = "van_real"
[axles.front]
kinematics = {"compression [mm]" = [-60, 60], "toe [deg]" = [0.4, -0.2], "camber [deg]" = [0, -2]}
[axles.rear]
side_force = {"side_force [kN]" = [-4, 4], "toe [deg]" = [-0.3, 0.3], "camber [deg]" = [-0.8, 0.8]}
"""


@pytest.mark.parametrize(
    "content",
    [
        pytest.param('base = "van_real"', id="plain"),
        pytest.param(BY_TABLES, id="by tables", marks=pytest.mark.slow),
    ],
)
def test_exported_vehicle_gives_the_same_run(tmp_path, content):
    """Every signal has the same bits, and every frame the same bytes and instants."""
    path, vehicle = tmp_path / "van.fmu", str(tmp_path / "my_van.toml")
    Path(vehicle).write_text(content)
    export_fmu.run(parse(["export-fmu", "vehicle", str(path), "--vehicle", vehicle]))
    assert validate_fmu(str(path)) == []
    traces = []
    for plant in ("nonlinear", str(path)):
        settings, controller = plan("double_lane_change", plant=plant, vehicle=vehicle)
        traces.append(drive(settings, controller, enabled=True, duration=3.0))
    ours, theirs = traces
    for name in ours.signals:
        np.testing.assert_array_equal(ours.signals[name], theirs.signals[name], err_msg=name)
    np.testing.assert_array_equal(np.asarray(ours.frames), np.asarray(theirs.frames))
    assert np.abs(ours.signals["moment_front"]).max() > 100


def test_foreign_vehicle_is_valid_fmi_2(foreign):
    assert validate_fmu(str(foreign)) == []


def test_foreign_vehicle_rolls_less_with_control(result):
    assert result.passive_metrics.roll_max_deg > 1.0
    assert result.helps
    # what the map gives arrives in the units of the map
    signals = result.controlled.signals
    assert signals["vx"][-1] == pytest.approx(80 / 3.6)
    assert np.degrees(signals["roll"]).max() < 10


def test_figures_without_their_signals_are_left_out(result):
    assert result.passive_metrics.nlt_front_max is None
    assert result.to_json()["controlled"]["nlt_rear_max"] is None
    assert result.without_roll == {"nlt_front_max": None, "nlt_rear_max": None}
    assert any("has no pitch, heave, wheel_load" in warning for warning in result.warnings)
    page = run_page(result)
    assert "Roll angle" in page
    assert "Wheel loads" not in page
    json.dumps(result.to_json(), allow_nan=False)
    criteria = [verdict.criterion for _, judged in result.standard.runs() for verdict in judged]
    assert "two-wheel lift" not in criteria


def test_same_run_twice(mapped, result):
    again = run("double_lane_change", plant=mapped(), **SHORT)
    np.testing.assert_array_equal(
        np.asarray(again.controlled.frames), np.asarray(result.controlled.frames)
    )


def test_rates_that_the_map_has_not_are_differences(mapped, result):
    settings, controller = plan("double_lane_change", plant=mapped(roll_rate="", vy=""))
    trace = drive(settings, controller, enabled=True, duration=1.5)
    known = result.controlled.signals
    for name, tolerance in (("roll_rate", 2e-3), ("vy", 2e-2)):
        assert np.abs(trace.signals[name] - known[name][:1500]).max() < tolerance
    assert np.abs(known["vy"][:1500]).max() > 0.1


def test_longer_step_holds_the_outputs(mapped):
    settings, controller = plan("double_lane_change", plant=mapped(step="step_ms = 5\n"))
    trace = drive(settings, controller, enabled=True, duration=1.5)
    x = trace.signals["x"]
    moved = np.flatnonzero(np.diff(x)) + 1
    assert set(np.diff(moved)) == {5}
    assert x[-1] == pytest.approx(80 / 3.6 * 1.5, rel=2e-2)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"grip": "gripp"}, "has no variable 'gripp': did you mean 'grip'?"),
        ({"yaw_rate": "yaw_rat"}, "unknown output"),
        ({"roll": ""}, "driver and sensors need roll"),
        ({"v0": ""}, "starts at 36 km/h, the manoeuvre at 80 km/h"),
        ({"Mf": ""}, "sets bar_moment_front to"),
        ({"delta": "phi"}, "phi is no input of the FMU (output)"),
        ({"step": "step_ms = 0\n"}, "step_ms must be a whole number of 1 to 20 ms, got 0"),
        ({"step": "steps = 1\n"}, "unknown key"),
        ({"start": "psi = 1.0"}, "psi cannot be set before the start (output)"),
        ({"start": 'crash = "late"'}, "crash is Real, 'late' is not"),
    ],
)
def test_map_that_does_not_fit_is_refused(mapped, changes, said):
    assert said in refusal(mapped(**changes))


def test_a_speed_over_time_needs_the_drive_force(mapped, tmp_path):
    file = tmp_path / "drive.csv"
    file.write_text("time,steering_wheel_deg,speed_kmh\n0,0,80\n2,20,70\n")
    options = {"file": str(file)}
    with pytest.raises(CanrollError, match=r"van\.fmu, which keeps its entry speed"):
        run("from_file", plant=mapped(), options=options, **SHORT)


@pytest.mark.parametrize(
    ("unit", "said"),
    [
        ("rad", "phi is in deg, the map has rad"),
        ("kN", "roll cannot be in kN, its SI unit is rad"),
        ("furlong", "unknown unit"),
    ],
)
def test_units_are_checked(foreign, tmp_path, unit, said):
    path = write_map(tmp_path / "map.toml")
    text = path.read_text().replace('"phi", unit = "deg"', f'"phi", unit = "{unit}"')
    path.write_text(text)
    assert said in refusal(f"{foreign}#{path}")


@pytest.mark.parametrize(
    ("able", "step", "said"),
    [
        ("", 1, "not a multiple of 5 ms, the step that it names and cannot vary"),
        ("", 5, None),
        ('canHandleVariableCommunicationStepSize="true"', 1, None),
    ],
)
def test_step_must_suit_the_fmu(tmp_path, able, step, said):
    path = write_fmu(tmp_path / "van.fmu", able=able)
    plant_map = write_map(tmp_path / "map.toml", step=f"step_ms = {step}\n")
    if said is None:
        assert body(f"{path}#{plant_map}").outside is not None
    else:
        message = refusal(f"{path}#{plant_map}")
        assert said in message
        assert "write step_ms = 5" in message


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("crash", "the FMU crashed at 1000 ms (SIGABRT)"),
        ("fail", "the FMU failed at 1000 ms"),
        ("lose", "phi is nan at 1001 ms"),
    ],
)
def test_failing_fmu_ends_in_one_line(mapped, how, said):
    assert said in refusal(mapped(start=f"{how} = 1.0"))


def test_message_of_the_fmu_is_shown(mapped):
    assert "the tyre has burst" in refusal(mapped(start="fail = 0.5"))


def test_not_an_fmu(tmp_path, capsys):
    path = tmp_path / "van.fmu"
    write_map(tmp_path / "van.toml")
    assert f"{path}: no such file" in refusal(str(path))
    path.write_bytes(b"PK")
    assert "not a valid FMU" in refusal(f"{path}#{tmp_path / 'van.toml'}")
    assert main(["run", "moose", "--plant", str(tmp_path / "other.fmu")]) == 2
    # the file that was named, not the map beside it
    assert f"{tmp_path / 'other.fmu'}: no such file" in capsys.readouterr().err
    path.with_name("alone.fmu").write_bytes(b"PK")
    assert "an FMU needs a map" in refusal(str(path.with_name("alone.fmu")))


def test_process_ends_with_the_world(mapped):
    settings, _ = plan("double_lane_change", plant=mapped())
    before = set(children())
    world = build_world(settings, enabled=False)
    world.advance(5_000_000)
    (process,) = set(children()) - before
    del world
    gc.collect()
    assert process not in children()


@pytest.mark.parametrize("changes", [{}, {"start": "crash = 1.0"}], ids=["ends", "crashes"])
def test_nothing_of_the_fmu_is_left_behind(mapped, tmp_path, monkeypatch, changes):
    room = tmp_path / "temporary"
    room.mkdir()
    monkeypatch.setenv("TMPDIR", str(room))
    monkeypatch.setattr(tempfile, "tempdir", None)
    settings, controller = plan("double_lane_change", plant=mapped(**changes))
    if changes:
        with pytest.raises(CanrollError, match="crashed at 1000 ms"):
            drive(settings, controller, enabled=False, duration=1.2)
    else:
        drive(settings, controller, enabled=False, duration=0.1)
    gc.collect()
    assert list(room.glob("canroll-fmu-*")) == []


def test_what_needs_our_equations_refuses_an_fmu(mapped):
    with pytest.raises(CanrollError, match="a campaign needs a model of canroll"):
        own_body(mapped(), "a campaign")


def test_actuators_that_need_travel_are_refused(mapped):
    assert "suspension need" in refusal(mapped(), actuator="suspension")
