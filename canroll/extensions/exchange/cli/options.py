"""The options of ``canroll export-fmu``."""

from canroll.cli.design_parsers import OF_AN_EXPORT
from canroll.cli.options import (
    DEFAULT_SCENARIO,
    add_choices,
    path_named,
    scenario,
)
from canroll.cli.parser import Parser, Relations
from canroll.setup.choices import CHOICES

OF_AN_FMU = {
    "ecu": (*OF_AN_EXPORT, "dbc", "map", "phase_ms", "seed"),
    "plant": (
        *(*OF_AN_EXPORT, "dbc", "map", "seed", "plant", "plant_vehicle"),
        *("speed_kmh", "options", "faults", "conditions"),
    ),
    "bus": ("bus", "dbc", "map", "seed", "actuator"),
    "vehicle": ("vehicle", "plant", "speed_kmh"),
}
"""What can be exported as an FMU, and the choices that apply to it."""
PORTS = ("can", "signals")


def export_fmu(parser: Parser) -> None:
    """Export ECU, plant or bus as an FMU (FMI 3.0)."""
    parser.add_argument("kind", choices=tuple(OF_AN_FMU), help="part of the run")
    parser.add_argument("out", type=path_named, metavar="OUT.fmu", help="file to write")
    parser.add_argument(
        "--ports",
        only=("ecu", "plant"),
        choices=PORTS,
        default=PORTS[0],
        help="CAN terminals (fmi-ls-bus), or plain signals (default: %(default)s)",
    )
    for name in CHOICES:
        kinds = [kind for kind, names in OF_AN_FMU.items() if name in names]
        if kinds:
            add_choices(parser, (name,))
            parser.relate(Relations(only=tuple(kinds)), name)
    parser.add_argument(
        "--scenario",
        only=("plant", "vehicle"),
        type=scenario,
        default=DEFAULT_SCENARIO,
        help="plant and vehicle: the manoeuvre (default: %(default)s)",
    )
    parser.add_argument(
        "--nodes",
        only=("bus",),
        type=int,
        default=0,
        metavar="N",
        help="bus: further nodes, on the first segment (default: %(default)s)",
    )
