"""Who may import whom: floors, no circles, firmware and plant apart, the drawing in docs true."""

from pathlib import Path

import pytest

from tools.floors import FLOORS, GROUND, circles, drawing, imports, modules, room_of, rooms, upward

ROOT = Path(__file__).parents[1]
MAY_IMPORT = {
    "dbc": set(),
    "vehicles": set(),
    "firmware": set(),
    "codegen": {"dbc", "firmware"},
    "gain_gen": {"codegen", "dbc", "firmware", "vehicles"},
    "plant_sim": {"codegen.frame", "codegen.generated", "dbc", "vehicles"},
}
"""Packages or rooms beside itself: firmware and plant stay apart; ``GROUND`` is everybody's."""
EXTENSIONS = "canroll.extensions."
MOST_FILES = {"canroll.firmware": 20, "canroll.cli": 40}
"""Rooms that may hold more files than others, ``__init__.py`` not counted; a command is a file."""


@pytest.fixture(scope="module")
def graph():
    return imports()


def package_of(name):
    return name.removeprefix("canroll.").split(".")[0]


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_a_package_imports_only_what_it_may(package, graph):
    allowed = {f"canroll.{name}" for name in (*MAY_IMPORT[package], package)}
    own = {name: targets for name, targets in graph.items() if package_of(name) == package}
    assert own
    wrong = [
        f"{name}: {target}"
        for name, targets in own.items()
        for target in targets
        if not {f"canroll.{package_of(target)}", target.rpartition(".")[0]} & allowed
        and target not in GROUND
    ]
    assert not wrong


def test_no_import_leads_upward(graph):
    assert upward(graph) == []


def test_no_circles_of_files_or_rooms(graph):
    assert circles(graph) == []
    assert circles(rooms(graph)) == []


def test_the_core_imports_no_extension_and_no_extension_another(graph):
    def extension(module):
        return module.removeprefix(EXTENSIONS).partition(".")[0] if EXTENSIONS in module else ""

    wrong = [
        f"{name}: {target}"
        for name, targets in graph.items()
        for target in targets
        if extension(target) not in ("", extension(name)) and not name.startswith("tools")
    ]
    assert not wrong


def test_every_room_stands_on_one_floor():
    known = modules()
    standing = {room_of(name, known) for name in known if known[name].read_text().strip()}
    listed = [room for level in FLOORS for room in level]
    assert len(listed) == len(set(listed))
    # nothing but rooms
    empty = {
        "canroll.codegen",
        "canroll.plant_sim",
        "canroll.hil",
        EXTENSIONS[:-1],
        f"{EXTENSIONS}car",
    }
    assert standing == {*listed} | empty


def test_a_room_is_not_crowded():
    known = modules()
    count = {}
    for name, path in known.items():
        if path.name != "__init__.py":
            room = name.rpartition(".")[0]
            count[room] = count.get(room, 0) + 1
    crowded = {room: n for room, n in count.items() if n > MOST_FILES.get(room, 16)}
    assert not crowded


@pytest.mark.drift
def test_the_drawing_of_the_architecture_is_true(graph):
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    assert drawing(graph) in page, "scripts/refresh-docs docs/architecture.md"


@pytest.mark.parametrize(
    ("graph", "found"),
    [
        ({"a": {"b"}, "b": {"c"}, "c": set()}, []),
        ({"a": {"b"}, "b": {"a"}, "c": {"a"}}, [["a", "b"]]),
        (
            {"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"e"}, "e": {"d"}},
            [["a", "b", "c"], ["d", "e"]],
        ),
    ],
)
def test_circles_are_found(graph, found):
    assert sorted(circles(graph)) == found


def test_an_import_upward_is_found(tmp_path):
    gain_gen = "from canroll.runs import trace\n"
    for package, text in (("", ""), ("gain_gen", gain_gen), ("runs", "")):
        (tmp_path / "canroll" / package).mkdir()
        (tmp_path / "canroll" / package / "__init__.py").write_text(text)
    (tmp_path / "canroll" / "runs" / "trace.py").write_text("")
    assert upward(imports(tmp_path), tmp_path) == ["canroll.gain_gen imports canroll.runs.trace"]
