"""A page's block counts as stale when what it read has changed, and only then."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import pytest

from tools.digests import load, save, state, stripped

ROOT = Path(__file__).parents[2]
CARS = "docs/cars.md"
DRIVE = "docs/drive.md"
NEVER = "not made with these commands"
PAGES = {
    CARS: """\
```console slow
$ grep -c mass vehicles/van_real.toml
```

```console slow
$ python -c "from canroll.vehicles.load import load; print(load('suv_2020').name)"
```
""",
    DRIVE: """\
```python child.py
import subprocess, sys
subprocess.run([sys.executable, "-c", "import canroll.plant_sim.bodies.roll"], check=True)
```

```console machine
$ echo first
```

<!-- slow, made by: python child.py -->
<!-- end -->
""",
}


def run(root, *arguments):
    """Refresh or list the pages of a copy of the project; return code and lines."""
    done = subprocess.run(
        [root / "scripts" / "refresh-docs", *arguments, *(root / page for page in PAGES)],
        env={name: text for name, text in os.environ.items() if name != "PYTHONPATH"},
        stdout=subprocess.PIPE,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout.splitlines()


def stale(root):
    """Return the places of stale blocks, each with why."""
    code, lines = run(root, "--list")
    assert code == bool(lines)
    return {line.split(": ")[0]: line.rsplit(": ", 1)[1] for line in lines}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Return a copy of the project with pages that have just been made, a line longer."""
    root = tmp_path_factory.mktemp("copy") / "project"
    left_out = shutil.ignore_patterns(".*", "__pycache__", "tests", "docs", "build", "out")
    shutil.copytree(ROOT, root, ignore=left_out, symlinks=True)
    (root / ".venv").symlink_to(ROOT / ".venv")
    (root / "docs").mkdir()
    for page, text in PAGES.items():
        (root / page).write_text(text, encoding="utf-8")
    assert list(stale(root)) == [f"{CARS}:1", f"{CARS}:5", f"{DRIVE}:6", f"{DRIVE}:10"]
    code, lines = run(root)
    assert code == 0, lines
    assert stale(root) == {}
    return root


@pytest.fixture
def edit(made):
    """Return a function that replaces text in a file of the copy until the test is over."""
    before = {file: file.read_text(encoding="utf-8") for file in (made / "docs").iterdir()}

    def replace(path, old, new):
        file = made / path
        text = file.read_text(encoding="utf-8")
        before.setdefault(file, text)
        assert old in text
        file.write_text(text.replace(old, new, 1), encoding="utf-8")

    yield replace
    for file, text in before.items():
        file.write_text(text, encoding="utf-8")


def test_a_line_of_the_plant_makes_stale_what_runs_it(made, edit):
    edit("plant_sim/bodies/roll.py", "\nBODY =", "\nNEW = 1\nBODY =")
    assert stale(made) == {f"{DRIVE}:11": "plant_sim/bodies"}


def test_a_docstring_or_a_comment_makes_nothing_stale(made, edit):
    edit("plant_sim/bodies/roll.py", '"""', '"""Reworded\n\nby several lines. ')
    edit("vehicles/load.py", "\nfrom", "\n# why\n\nfrom")
    assert stale(made) == {}


def test_data_make_stale_what_reads_them_and_what_comes_after(made, edit):
    edit("vehicles/van_real.toml", "\n", "\n\n")
    assert stale(made) == {page: "vehicles/van_real.toml" for page in (f"{CARS}:1", f"{CARS}:6")}


def test_a_command_or_a_file_makes_stale_its_block_and_those_after(made, edit):
    edit(CARS, "load('suv_2020')", "load('van_2022')")
    assert set(stale(made)) == {f"{CARS}:6"}
    edit(DRIVE, "import canroll.plant_sim.bodies.roll", "import canroll.vehicles")
    assert set(stale(made)) == {f"{CARS}:6", f"{DRIVE}:6", f"{DRIVE}:11"}


def test_what_is_stale_is_made_and_the_rest_left(made, edit):
    edit(CARS, "suv_2020", "van_2022")
    edit(DRIVE, "echo first", "echo first; exit 1")
    code, lines = run(made, "--stale")
    assert code == 1 and any(f"{DRIVE}:6: exit code 1" in line for line in lines)
    assert "\nvan_2022\n" in (made / CARS).read_text()
    # what comes after a failure may be wrong
    assert stale(made) == dict.fromkeys((f"{DRIVE}:6", f"{DRIVE}:11"), NEVER)


def test_modules_count_wherever_their_code_is_read_from(made):
    path = made / "docs" / "digests.json"
    cold = load(path)
    assert run(made)[0] == 0
    assert load(path) == cold
    (by_a_child,) = (parts for parts in cold.values() if "plant_sim/bodies" in parts)
    assert {"vehicles", "plant_sim/kernels", "canroll"} <= set(by_a_child)


def test_a_forked_worker_is_recorded(tmp_path):
    record = tmp_path / "record"
    code = "from multiprocessing import *; from importlib import *; set_start_method('fork'); "
    code += "worker = Process(target=import_module, args=('vehicles.load',)); "
    code += "worker.start(); worker.join()"
    subprocess.run(
        [ROOT / ".venv" / "bin" / "python", "-c", code],
        env=os.environ
        | {
            "CANROLL_RECORD": str(record),
            "PYTHONPATH": f"{ROOT / 'scripts' / 'recorder'}{os.pathsep}{ROOT}",
        },
        check=True,
    )
    assert str(ROOT / "vehicles" / "load.py") in record.read_text().splitlines()


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ('"""Old."""\na = 1\n', '"""New\n\ntext."""\n\n\na = 1\n', True),
        ("def f():\n    'Old.'\n    return 1", "def f():\n    # New.\n    return 1\n", True),
        ("a = 1\n'old'\n", "a = 1\n'new'  # of a\n", True),
        ("def f(): 'one line'\n", "def f(): 'other line'\n", False),
        ('a = """\n# 1\n"""\n', 'a = """\n# 2\n"""\n', False),
        ('a = f"""{b}\n\n# 1\n"""\n', 'a = f"""{b}\n# 1\n"""\n', False),
        ("a = (\n    # old\n    1\n)\n", "a = (\n    1\n)\n", True),
        ("a = 1\n", "a = 2\n", False),
    ],
)
def test_only_what_runs_counts(one, other, same):
    assert (stripped(one) == stripped(other)) is same


def test_a_new_module_is_a_change_of_its_folder(tmp_path):
    (tmp_path / "dbc").mkdir()
    (tmp_path / "dbc" / "a.py").write_text("a = 1\n")
    (tmp_path / "dbc" / "own.dbc").write_text("1\n")
    before = state(tmp_path)
    assert set(before) == {"dbc", "dbc/own.dbc"}
    (tmp_path / "dbc" / "b.py").write_text("b = 1\n")
    (tmp_path / "linked").symlink_to("dbc")
    after = state(tmp_path)
    assert set(after) == set(before) and after["dbc/own.dbc"] == before["dbc/own.dbc"]
    assert after["dbc"] != before["dbc"]


def test_a_template_is_of_its_folder_of_sources(tmp_path):
    (tmp_path / "room" / "templates").mkdir(parents=True)
    (tmp_path / "room" / "templates" / "Makefile").write_text("all:\n")
    before = state(tmp_path)
    (tmp_path / "room" / "templates" / "Makefile").write_text("none:\n")
    assert set(before) == {"room/templates"} and state(tmp_path) != before


def test_digests_are_kept_a_line_a_block(tmp_path):
    path = tmp_path / "digests.json"
    kept = {"docs/a.md 1": {"room": "1a", "room/data of 1.csv": "2b"}, "docs/b.md 2": {}}
    save(path, kept)
    assert load(path) == kept and len(path.read_text().splitlines()) == 4
    assert set(json.loads(path.read_text())) == set(kept)
