"""The floors of the project, its import graph, and the drawing of both.

    python -m tools.floors     prints the drawing of docs/architecture.md (Mermaid)

A room is a folder with the Python files directly in it. A file imports from its own room or from
rooms on lower floors; rooms on the same floor do not import each other.
"""

import ast
import re
from collections.abc import Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

FLOORS: tuple[tuple[str, ...], ...] = (
    ("canroll.build_cache", "canroll.errors"),
    (
        "canroll.arguments",
        "canroll.documents",
        "canroll.extension",
        "canroll.table",
        "canroll.typing",
    ),
    ("canroll.registry",),
    ("plant_sim.kernels", "dbc", "firmware", "vehicles.suspensions", "vehicles.tyres"),
    ("vehicles", "codegen.operations"),
    ("vehicles.draws",),
    ("plant_sim.can_bus.wire", "plant_sim.buses", "codegen.subset"),
    ("plant_sim.can_bus.kernel", "codegen.proof"),
    ("plant_sim.can_bus.logs", "codegen.c99"),
    ("plant_sim.can_bus.traffic", "codegen.frame"),
    ("codegen.generated",),
    ("plant_sim.can_bus.network",),
    ("plant_sim.can_bus.bounds", "plant_sim.can_bus.simulation"),
    ("plant_sim.can_bus",),
    ("plant_sim.can_bus.servers", "codegen.run"),
    (
        "plant_sim.bodies",
        "codegen.export.sessions",
        "codegen.worst_case",
        "gain_gen.models",
    ),
    ("plant_sim.nodes", "plant_sim.driving", "codegen.export", "gain_gen.analysis"),
    ("plant_sim.faults", "gain_gen.laws"),
    ("plant_sim.world",),
    ("gain_gen.monitors", "gain_gen.output_feedback"),
    ("gain_gen.calibration",),
    ("gain_gen",),
    ("canroll.reaction", "canroll.network", "canroll.setup"),
    ("canroll.runs",),
    ("canroll.cases", "hil.hardware"),
    ("hil",),
    ("canroll.report",),
    ("canroll.studies", "canroll.handling", "hil.watch"),
    ("canroll.cli",),
    ("canroll",),
    (
        "canroll.extensions.campaign",
        "canroll.extensions.campaign.attacks",
        "canroll.extensions.campaign.faults",
        "canroll.extensions.car.sizing",
        "canroll.extensions.car.identification",
        "canroll.extensions.papers",
        "canroll.extensions.exchange.fmi",
        "canroll.extensions.exchange.fmu",
        "canroll.extensions.exchange.kernels",
        "canroll.extensions.certify",
        "canroll.extensions.services.modules",
    ),
    (
        "canroll.extensions.car.tyres",
        "canroll.extensions.car.validation",
        "canroll.extensions.exchange",
        "canroll.extensions.services",
    ),
    (
        "canroll.extensions.campaign.cli",
        "canroll.extensions.car.cli",
        "canroll.extensions.papers.cli",
        "canroll.extensions.exchange.cli",
        "canroll.extensions.certify.cli",
    ),
    ("tools",),
)
"""Rooms, lowest floor first; the three lowest hold single files."""

GROUND = tuple(
    f"canroll.{name}"
    for name in (
        *("arguments", "build_cache", "documents", "errors", "extension", "registry", "table"),
        "typing",
    )
)
"""Files of ``canroll`` that all may import; the rest of it is on the highest floor."""
BASE = "base of canroll"
LOOP = "firmware"
"""The integer subset; its parser refuses modules that import each other."""
PACKAGES = ("canroll", "codegen", "dbc", "firmware", "gain_gen", "hil", "plant_sim", "tools")
PACKAGES += ("vehicles",)

Graph = Mapping[str, frozenset[str]]


def modules(root: Path = ROOT) -> dict[str, Path]:
    """Return the modules of the project by dotted name; a package is its ``__init__.py``."""
    return {
        ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__"): path
        for package in PACKAGES
        for path in sorted((root / package).rglob("*.py"))
    }


def imports(root: Path = ROOT) -> dict[str, frozenset[str]]:
    """Return the modules of the project that each module imports, also inside functions."""
    known = modules(root)
    return {
        name: frozenset(_imported(path, known)) - {name} for name, path in sorted(known.items())
    }


def _imported(path: Path, known: Mapping[str, Path]) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in known)
        elif isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                if inner in known or node.module in known:
                    yield inner if inner in known else node.module


def room_of(module: str, known: Mapping[str, Path]) -> str:
    """Return the room of a module; the ECU's loop is one, whatever folders it has."""
    if module in GROUND:
        return module
    if module.split(".", maxsplit=1)[0] == LOOP:
        return LOOP
    package = known[module].name == "__init__.py"
    return module if package else module.rpartition(".")[0]


def rooms(graph: Graph, root: Path = ROOT) -> dict[str, frozenset[str]]:
    """Return the rooms that each room imports from."""
    known = modules(root)
    found: dict[str, set[str]] = {}
    for module, targets in graph.items():
        room = room_of(module, known)
        found.setdefault(room, set()).update(room_of(target, known) for target in targets)
    return {room: frozenset(targets - {room}) for room, targets in found.items()}


def circles(graph: Graph) -> list[list[str]]:
    """Return the strongly connected parts of a graph with more than one node (Tarjan)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(node: str) -> None:
        index[node] = low[node] = len(index)
        stack.append(node)
        for target in sorted(graph.get(node, ())):
            if target not in index:
                visit(target)
                low[node] = min(low[node], low[target])
            elif target in stack:
                low[node] = min(low[node], index[target])
        if low[node] == index[node]:
            part = stack[stack.index(node) :]
            del stack[stack.index(node) :]
            if len(part) > 1:
                found.append(sorted(part))

    for node in sorted(graph):
        if node not in index:
            visit(node)
    return found


def drawing(graph: Graph) -> str:
    """Return packages and extensions as a Mermaid flowchart without arrows implied by others."""
    found: dict[str, set[str]] = {}
    for room, targets in rooms(graph).items():
        found.setdefault(_part(room), set()).update(map(_part, targets))
    arrows = {part: frozenset(targets - {part}) for part, targets in found.items()}
    lines = ["```mermaid", "flowchart TD"]
    lines += [f'    {_id(part)}["{part}"]' for part in sorted(arrows)]
    for part in sorted(arrows):
        for target in sorted(arrows[part]):
            if not any(target in _reached(arrows, other) for other in arrows[part] - {target}):
                lines.append(f"    {_id(part)} --> {_id(target)}")
    return "\n".join([*lines, "```"])


def _part(room: str) -> str:
    """Return the package of a room, of ``canroll`` the room or the extension."""
    if room in GROUND:
        return BASE
    within = room.partition("canroll.extensions.")[2]
    if within:
        return f"extension {within.partition('.')[0]}"
    return room if room.startswith("canroll") else room.partition(".")[0]


def _id(part: str) -> str:
    return re.sub(r"\W", "_", part)


def _reached(found: Graph, room: str) -> set[str]:
    """Return all rooms that ``room`` imports from, directly or not."""
    todo, seen = [room], set()
    while todo:
        for target in found.get(todo.pop(), frozenset()) - seen:
            seen.add(target)
            todo.append(target)
    return seen


def upward(graph: Graph, root: Path = ROOT) -> list[str]:
    """Return the imports that lead neither to a lower floor nor to the same room, as text."""
    known = modules(root)
    floor = {room: number for number, level in enumerate(FLOORS) for room in level}
    return [
        f"{module} imports {target}"
        for module, targets in graph.items()
        for target in sorted(targets)
        for here, there in ((room_of(module, known), room_of(target, known)),)
        if here != there and floor.get(here, -1) <= floor.get(there, len(FLOORS))
    ]


if __name__ == "__main__":
    print(drawing(imports()))
