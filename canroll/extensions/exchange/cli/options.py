"""The options of ``canroll export-fmu``."""

from canroll.cli.design_parsers import OF_AN_EXPORT
from canroll.cli.options import DEFAULT_SCENARIO, RARE_OF_A_DESIGN, choices, path_named, scenario
from canroll.cli.parser import Parser, opt, related
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


OF_KINDS = {
    name: tuple(kind for kind, names in OF_AN_FMU.items() if name in names) for name in CHOICES
}
"""The same by the choice."""


def export_fmu(parser: Parser) -> None:
    """Export ECU, plant or bus as an FMU (FMI 3.0)."""
    applying = [name for name, kinds in OF_KINDS.items() if kinds]
    parser.take(
        "",
        opt("kind", tuple(OF_AN_FMU), None, "part of the run"),
        opt("out", path_named, "OUT.fmu", "file to write"),
        opt("--ports", PORTS, None, "CAN terminals (fmi-ls-bus), or plain signals (default: "
            "%(default)s)", PORTS[0], only=("ecu", "plant")),
        choices(applying, of_file=RARE_OF_A_DESIGN),
        *(related(name, only=OF_KINDS[name]) for name in applying),
        opt("--scenario", scenario, None, "plant and vehicle: the manoeuvre (default: "
            "%(default)s)", DEFAULT_SCENARIO, only=("plant", "vehicle")),
        opt("--nodes", int, "N", "bus: further nodes, on the first segment (default: %(default)s)",
            0, only=("bus",)),
    )  # fmt: skip
