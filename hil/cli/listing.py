"""``canroll list``: what can be named on a command line, and where it comes from."""

import argparse
import json
from typing import Any

import vehicles
from canroll.registry import BUILT_IN, Registry
from gain_gen.laws import LAWS
from plant_sim.bodies import BODIES
from plant_sim.buses import BUSES
from plant_sim.driving import MANEUVERS

REGISTRIES: dict[str, Registry[Any]] = {
    "laws": LAWS,
    "scenarios": MANEUVERS,
    "buses": BUSES,
    "bodies": BODIES,
}


def run(args: argparse.Namespace) -> int:
    """Print a line each, or one JSON array."""
    rows = entries(args.kind)
    if args.json:
        print(json.dumps(rows, ensure_ascii=False))
        return 0
    widths = [max(len(row[key]) for row in rows) for key in ("name", "origin")]
    for row in rows:
        name, origin = f"{row['name']:<{widths[0]}}", f"{row['origin']:<{widths[1]}}"
        print(f"{name}  {origin}  {row['description']}".rstrip())
    return 0


def entries(kind: str) -> list[dict[str, str]]:
    """Return name, origin and one line of description of everything of a kind.

    Nothing is loaded for that: an extension that cannot be imported is listed as well.
    """
    if kind not in REGISTRIES:
        return [
            {"name": name, "origin": BUILT_IN, "description": vehicles.load(name).title}
            for name in vehicles.names()
        ]
    known = REGISTRIES[kind]
    return [
        {
            "name": name,
            "origin": known.origin(name).who,
            "description": known.description(name).removesuffix("."),
        }
        for name in known
    ]
