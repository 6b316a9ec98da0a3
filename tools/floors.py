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
    (
        "canroll.plant_sim.kernels",
        "canroll.dbc",
        "canroll.firmware",
        "canroll.vehicles.suspensions",
        "canroll.vehicles.tyres",
    ),
    ("canroll.vehicles", "canroll.codegen.operations"),
    ("canroll.vehicles.draws",),
    ("canroll.plant_sim.can_bus.wire", "canroll.plant_sim.buses", "canroll.codegen.subset"),
    ("canroll.plant_sim.can_bus.kernel", "canroll.codegen.proof"),
    ("canroll.plant_sim.can_bus.logs", "canroll.codegen.c99"),
    ("canroll.plant_sim.can_bus.traffic", "canroll.codegen.frame"),
    ("canroll.codegen.generated",),
    ("canroll.plant_sim.can_bus.network",),
    ("canroll.plant_sim.can_bus.bounds", "canroll.plant_sim.can_bus.simulation"),
    ("canroll.plant_sim.can_bus",),
    ("canroll.plant_sim.can_bus.servers", "canroll.codegen.run"),
    (
        "canroll.plant_sim.bodies",
        "canroll.codegen.export.sessions",
        "canroll.codegen.worst_case",
        "canroll.gain_gen.models",
    ),
    (
        "canroll.plant_sim.nodes",
        "canroll.plant_sim.driving",
        "canroll.codegen.export",
        "canroll.gain_gen.analysis",
    ),
    ("canroll.plant_sim.faults", "canroll.gain_gen.laws"),
    ("canroll.plant_sim.world",),
    ("canroll.gain_gen.monitors", "canroll.gain_gen.output_feedback"),
    ("canroll.gain_gen.calibration",),
    ("canroll.gain_gen",),
    ("canroll.reaction", "canroll.network", "canroll.setup"),
    ("canroll.runs",),
    ("canroll.cases", "canroll.hil.hardware"),
    ("canroll.hil",),
    ("canroll.report",),
    ("canroll.studies", "canroll.handling", "canroll.hil.watch"),
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
LOOP = "canroll.firmware"
"""The integer subset; its parser refuses modules that import each other."""
LINKED = ("codegen", "dbc", "firmware", "gain_gen", "hil", "plant_sim", "vehicles")
"""Folders at the top that are packages of ``canroll``, by links in its folder."""

Graph = Mapping[str, frozenset[str]]


def modules(root: Path = ROOT) -> dict[str, Path]:
    """Return the modules of the project by dotted name; a package is its ``__init__.py``."""
    return {
        ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__"): path
        for folder in ("canroll", *(f"canroll/{name}" for name in LINKED), "tools")
        for path in sorted((root / folder).rglob("*.py"))
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
    if f"{module}.".startswith(f"{LOOP}."):
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
    package = room.removeprefix("canroll.").partition(".")[0]
    return package if package in (*LINKED, "tools") else room


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
