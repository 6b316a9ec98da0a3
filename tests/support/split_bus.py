"""examples/own_bus as two descriptions: the maker's file, and that of the own actuators."""

import re
from pathlib import Path

OWN = Path(__file__).parents[2] / "examples" / "own_bus" / "own.dbc"
MAP = OWN.with_suffix(".toml")
ACTUATORS = ("ACT_01", "ROLL_CMD", "ROLL_BAR", "ROLL_ST")


def write(folder: Path) -> tuple[Path, Path]:
    """Write car.dbc and actuators.dbc, which together have the messages of own.dbc in its order."""
    text = OWN.read_text(encoding="utf-8")
    names = dict(re.findall(r"^BO_ (\d+) (\w+):", text, flags=re.MULTILINE))
    paths = folder / "car.dbc", folder / "actuators.dbc"
    for path, own in zip(paths, (False, True), strict=True):
        others = [ident for ident, name in names.items() if (name in ACTUATORS) != own]
        part = text
        for ident in others:
            part = re.sub(rf"^BO_ {ident} .*\n(?: SG_ .*\n)*", "", part, flags=re.MULTILINE)
            part = re.sub(rf'^BA_ "\w+" BO_ {ident} .*\n?', "", part, flags=re.MULTILINE)
        path.write_text(part, encoding="utf-8")
    return paths
