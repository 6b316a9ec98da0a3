"""Extensions by "file.py:name", "module:name" and entry point: found, or refused in one line."""

import json
import sys

import pytest

from canroll import extension
from canroll.cli.listing import REGISTRIES
from canroll.cli.main import main
from canroll.errors import CanrollError
from canroll.gain_gen.laws import LAWS
from canroll.plant_sim.bodies import BODIES
from canroll.plant_sim.buses import BUSES
from canroll.plant_sim.driving import MANEUVERS
from canroll.registry import Registry
from canroll.vehicles import load

LAW = '''
from dataclasses import replace

import numpy as np

from canroll.gain_gen.laws.state_feedback import design_lqr
from canroll.gain_gen.models.controller import scaled_controller


def good(task):
    """The textbook gain.

    Less 4 dB, as the built-in law is detuned on this bus.
    """
    solution = design_lqr(task)
    return replace(solution, controller=scaled_controller(solution.controller, 10.0**-0.2))


def two(task, other):
    return design_lqr(task)


def fails(task):
    return 1 / 0


def exits(task):
    raise SystemExit("no")


def number(task):
    return 5


def short(task):
    solution = design_lqr(task)
    return replace(solution, controller=replace(solution.controller, feedback=np.zeros(3)))


def slow(task):
    solution = design_lqr(task)
    return replace(solution, controller=replace(solution.controller, tick=2 * task.tick))


text = "no law"
'''
PLANTS = """
import numpy as np

from canroll.plant_sim.bodies import ports, roll
from canroll.plant_sim.bodies.ports import Body
from canroll.plant_sim.kernels.jit import cfunc

BODY = Body("twin", roll.step, roll.build)
'''As roll1.'''
PYTHON = Body("python", lambda *given: None, roll.build)
NO_SPEED = Body("no_speed", roll.step, lambda vehicle: roll.build(vehicle, 1.0))
LARGE = Body("large", roll.step, lambda vehicle, speed: (np.zeros(65), np.zeros(1)))
WHOLE = Body("whole", roll.step, lambda vehicle, speed: (np.zeros(7, int), np.zeros(1)))
ENDLESS = Body("endless", roll.step, lambda vehicle, speed: (np.full(7, np.inf), np.zeros(1)))


@cfunc("void(f8[::1], f8)")
def other(state, dt):
    state[0] = dt


SIGNATURE = Body("signature", other, roll.build)
"""
MANOEUVRES = """
import numpy as np

from canroll.plant_sim.driving.drive import ManeuverKind, ManeuverPlan
from canroll.plant_sim.driving.driver import STEER_TABLE


def plan(table, **more):
    def made(vehicle, speed, seed, *, scale: float = 1.0):
        return ManeuverPlan(2.0, kind=STEER_TABLE, table=table, **more)

    return made


GOOD = ManeuverKind("step", 60.0, 120.0, "none", plan(np.full(10, 0.01)))
NO_TABLE = ManeuverKind("step", 60.0, 120.0, "none", plan(None))
WHOLE = ManeuverKind("step", 60.0, 120.0, "none", plan(np.arange(10)))
ENDLESS = ManeuverKind("step", 60.0, 120.0, "none", plan(np.full(10, np.nan)))
PATH = ManeuverKind(
    "step", 60.0, 120.0, "none", plan(np.zeros(9), path_xy=(np.zeros(4), np.zeros(5)))
)
FAST = ManeuverKind("step", 60.0, 1200.0, "none", plan(np.zeros(9)))
SPEEDS = ManeuverKind("step", 60.0, 120.0, "none", plan(np.zeros(9), speed=[20.0, 21.0]))
OPTION = ManeuverKind("step", 60.0, 120.0, "none", lambda vehicle, speed, seed, *, where=None: None)
"""
BUS = """
from canroll.plant_sim.buses.profile import BusProfile

GOOD = BusProfile("quiet", 250_000, 0.4)
FULL = BusProfile("full", 250_000, 1.0)
SLOW = BusProfile("slow", 100, 0.5)
BACKWARDS = BusProfile("backwards", 250_000, 0.5, gateway_ms=(5.0, 2.0))
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return the current folder, with the files of extensions in it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    for name, text in {"law": LAW, "plants": PLANTS, "drives": MANOEUVRES, "bus": BUS}.items():
        (tmp_path / f"{name}.py").write_text(text)
    (tmp_path / "broken.py").write_text("def law(task:\n")
    (tmp_path / "absent.py").write_text("import no_such_module\n")
    (tmp_path / "old.py").write_text("from gain_gen.laws import declared\n")
    (tmp_path / "exits.py").write_text("import sys\nsys.exit()\n")
    for registry in (LAWS, BODIES, MANEUVERS, BUSES):
        known = dict(registry._loaded)
        monkeypatch.setattr(registry, "_loaded", known)
    return tmp_path


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("nowhere.py:law", "nowhere.py: no such file"),
        ("law.py:nothing", "law.py defines no 'nothing'"),
        ("law.py:", "write it as file.py:name or module:name"),
        ("law.py:two", "law.py, line 19: takes (task, other), it is called with 1 argument"),
        ("law.py:fails", "law.py, line 24: ZeroDivisionError: division by zero"),
        ("law.py:exits", "law.py, line 28: SystemExit: no"),
        ("law.py:number", "law.py, line 31: returns a int, it must be a Solution"),
        ("law.py:short", "feedback has the shape (3,), it must be (5,)"),
        ("law.py:slow", "a tick of 0.02 s, its task has 0.01 s"),
        ("law.py:text", "a str, it must be a function"),
        ("broken.py:law", "SyntaxError: '(' was never closed (broken.py, line 1)"),
        ("absent.py:law", "ModuleNotFoundError: No module named 'no_such_module'"),
        ("old.py:law", "ImportError: the package is canroll.gain_gen"),
        ("exits.py:law", "exits.py, line 2: SystemExit"),
        ("no_such_module:law", "ModuleNotFoundError: No module named 'no_such_module'"),
        ("json:law", "defines no 'law'"),
    ],
)
def test_a_broken_law_is_refused_in_one_line_that_names_the_file(folder, name, told, capsys):
    assert main(["design", "--law", name]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"canroll: law '{name}': ") and told in line
    assert not (folder / "out").exists()


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("PYTHON", "its step must be compiled"),
        ("SIGNATURE", "its step must be compiled"),
        ("NO_SPEED", "takes (vehicle), it is called with 2 arguments"),
        ("LARGE", "65 values of state, at most 64"),
        ("WHOLE", "its state must be a float64 array"),
        ("ENDLESS", "its state is not finite"),
        ("ports", "a module, it must be a Body"),
    ],
)
def test_a_broken_body_is_refused_before_it_is_stepped(folder, name, told):
    with pytest.raises(CanrollError, match=r"plants\.py") as refused:
        BODIES[f"plants.py:{name}"].build(load("van_real"), 20.0)
    assert told in str(refused.value)


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("NO_TABLE", "table is missing"),
        ("WHOLE", "table must hold float64"),
        ("ENDLESS", "finite values"),
        ("SPEEDS", "speed must hold float64 arrays of one dimension"),
        ("PATH", "path_xy must be two arrays of one length"),
        ("FAST", "speeds of 60 and at most 1200"),
        ("OPTION", "option where needs a default"),
        ("plan", "a function, it must be a Kind"),
    ],
)
def test_a_broken_manoeuvre_is_refused_before_it_is_driven(folder, name, told):
    with pytest.raises(CanrollError, match=r"drives\.py") as refused:
        MANEUVERS[f"drives.py:{name}"].plan(load("van_real"), 20.0, 0)
    assert told in str(refused.value)


@pytest.mark.parametrize(
    ("name", "told"),
    [("FULL", "load 1.0"), ("SLOW", "bitrate 100"), ("BACKWARDS", "gateway_ms (5.0, 2.0)")],
)
def test_a_bus_that_cannot_be_is_refused(folder, name, told):
    with pytest.raises(CanrollError) as refused:
        BUSES[f"bus.py:{name}"]
    assert str(refused.value).startswith(f"bus profile 'bus.py:{name}': {told}")


def test_a_run_of_nothing_but_extensions(folder, capsys):
    arguments = ["--plant", "plants.py:BODY", "--bus", "bus.py:GOOD", "--law", "law.py:good"]
    assert main(["run", "drives.py:GOOD", *arguments, "--set", "scale=2", "--out", "kept"]) in (
        0,
        1,
    )
    capsys.readouterr()
    text = (folder / "kept" / "calibration.toml").read_text()
    assert 'law = "law.py:good"' in text
    assert 'law_from = "file law.py, SHA-256 ' in text
    assert main(["run", "kept", "--json"]) in (0, 1)
    again = json.loads(capsys.readouterr().out)
    assert again["law"] == "law.py:good"
    assert again["scenario"] == "drives.py:GOOD"
    assert (again["plant"], again["bus"]) == ("plants.py:BODY", "bus.py:GOOD")
    # the same body under another name drives the same way
    ours_too = ["--bus", "bus.py:GOOD", "--law", "lqr", "--plant", "roll1", "--json"]
    assert main(["run", "drives.py:GOOD", *ours_too]) in (0, 1)
    ours = json.loads(capsys.readouterr().out)
    assert ours["controlled"] == again["controlled"]


def test_worker_processes_find_extensions(folder, capsys):
    arguments = ["drives.py:GOOD", "--law", "law.py:good", "--plant", "plants.py:BODY"]
    arguments += ["--runs", "2"]
    found = []
    for jobs in ("1", "2"):
        assert main(["campaign", *arguments, "--jobs", jobs, "--bus", "bus.py:GOOD", "--json"]) in (
            0,
            1,
        )
        found.append(json.loads(capsys.readouterr().out))
    assert found[0]["law"] == "law.py:good"
    assert found[0]["quantiles"] == found[1]["quantiles"]
    assert found[0]["worst"] == found[1]["worst"]


def test_laws_of_files_are_compared_and_swept(folder, capsys):
    assert main(["compare", "law.py:good", "law=law.py:good,bus=bus.py:GOOD", "--json"]) == 0
    capsys.readouterr()
    assert main(["compare", "law.py:good", "lqr", "--speed", "60:60:1", "--json"]) in (0, 1)
    laws = json.loads(capsys.readouterr().out)["laws"]
    assert [run["controlled"] for run in laws["law.py:good"]] == [
        run["controlled"] for run in laws["lqr"]
    ]


def test_a_file_finds_modules_beside_it_that_hide_nothing(folder):
    (folder / "json.py").write_text("raise RuntimeError\n")
    (folder / "beside.py").write_text("VALUE = 7\n")
    (folder / "main.py").write_text("import json\nimport beside\nVALUE = beside.VALUE\n")
    assert extension.load("number", "main.py:VALUE") == 7


def test_an_entry_point_that_fails_names_its_package(folder, monkeypatch):
    package = folder / "offers-1.0.dist-info"
    package.mkdir()
    (package / "METADATA").write_text("Metadata-Version: 2.1\nName: offers\nVersion: 1.0\n")
    points = "[canroll.numbers]\none = absent:law\ntwo = law:good\n"
    (package / "entry_points.txt").write_text(points)
    monkeypatch.syspath_prepend(str(folder))
    numbers: Registry[object] = Registry("number", "canroll.numbers", {})
    with pytest.raises(CanrollError, match=r"^number 'one' of offers 1\.0: ModuleNotFoundError"):
        numbers["one"]
    assert numbers.origin("two").who == "offers 1.0"
    assert numbers.description("two") == "The textbook gain."


@pytest.mark.parametrize("kind", ["laws", "vehicles", "scenarios", "buses", "bodies"])
def test_everything_that_has_a_name_is_listed_with_a_description(kind, capsys):
    assert main(["list", kind, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert all(row["origin"] == "built in" and len(row["description"]) > 8 for row in rows)
    assert main(["list", kind]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == [row["name"] for row in rows]
    if kind in REGISTRIES:
        assert [row["name"] for row in rows] == list(REGISTRIES[kind])


def test_limit_takes_a_body_a_law_and_a_bus_of_a_file(folder, capsys):
    arguments = ["--plant", "plants.py:BODY", "--bus", "bus.py:GOOD", "--law", "law.py:good"]
    speeds = ["--from", "40", "--to", "70", "--tolerance", "30"]
    assert main(["handling", "limit", "moose", *arguments, *speeds, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["plant"], found["law"]) == ("plants.py:BODY", "law.py:good")
    assert main(["handling", "limit", "moose", *speeds, "--plant", "plants.py:NOTHING"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_the_plant_alone_takes_a_body_and_a_bus_of_a_file(folder, capsys):
    arguments = ["plant", "drives.py:GOOD", "--prepare", "--bus", "bus.py:GOOD"]
    assert main([*arguments, "--plant", "plants.py:BODY"]) == 0
    assert main([*arguments, "--plant", "plants.py:NOTHING"]) == 2
    assert "plants.py defines no 'NOTHING'" in capsys.readouterr().err
