"""calibration.toml: physical values, integers, formats, provenance, verdicts; writer and reader."""

import hashlib
import json
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import tomli_w

from canroll import documents, vehicles
from canroll.arguments import checked
from canroll.codegen.generated import own_stage
from canroll.codegen.generated.own_stage import OwnStage
from canroll.codegen.run.memory_image import sealed
from canroll.errors import CanrollError, reason
from canroll.firmware.calibration import Calibration
from canroll.firmware.subset import Field, fields
from canroll.gain_gen.calibration.record import RESERVED, fill
from canroll.vehicles import Vehicle

SCHEMA = 3
DIGEST = "digest"
"""Key of the file's :func:`digest`."""
VEHICLE = "vehicle"
"""Table with the document of the vehicle."""

TABLES = frozenset(
    {
        "schema",
        DIGEST,
        "design",
        "plant",
        "gains",
        "margins",
        "verification",
        "formats",
        "provenance",
        "uncertainty",
        VEHICLE,
        "calibration",
    }
)
OPTIONAL = frozenset({"budget", "stage"})
"""Tables that a user may add: the budget of a tick, a user's stage of the loop."""
NEEDED: Mapping[str, Mapping[str, tuple[type, ...]]] = {
    "design": {
        **dict.fromkeys(("law", "vehicle", "actuator"), (str,)),
        **{"verified": (bool,), "tick_s": (int, float), "warnings": (list,)},
    },
    "margins": {"max_delay_s": (int, float)},
    "provenance": {"vehicle_sha256": (str,)},
}
"""What else than the integers is read from a file, by table: keys and types."""


@dataclass(frozen=True, slots=True)
class LoadedCalibration:
    """A calibration file: the record that the ECU runs, and its other tables.

    Attributes:
        record: the integers.
        tables: every other table of the file, as read.
        path: file it was read from.
        vehicle: the vehicle it was designed for, from the file itself.
    """

    record: Calibration
    tables: Mapping[str, Any]
    path: Path
    vehicle: Vehicle

    @property
    def law(self) -> str:
        """Name of the law."""
        return str(self.tables["design"]["law"])

    @property
    def actuator(self) -> str:
        """Kind of actuator."""
        return str(self.tables["design"]["actuator"])

    @property
    def stage(self) -> OwnStage | None:
        """The own stage that runs with it."""
        return own_stage.carried(self.tables)

    @property
    def verified(self) -> bool:
        """Whether every check of the design held."""
        return bool(self.tables["design"]["verified"])

    @property
    def failed(self) -> list[str]:
        """The checks of the design that did not hold, in words."""
        return [str(text) for text in self.tables["design"].get("failed", ())]

    @property
    def tick(self) -> float:
        """Period of the loop, s."""
        return float(self.tables["design"]["tick_s"])

    @property
    def max_delay(self) -> float:
        """Largest stable sample-to-force delay of the design, s; infinite if any."""
        return float(self.tables["margins"]["max_delay_s"])

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings for the user, one line each."""
        return tuple(self.tables["design"]["warnings"])

    def delay_warning(self, delay: float) -> str:
        """Return a warning if a sample-to-force delay of ``delay`` seconds is too long, or ''."""
        if delay < self.max_delay:
            return ""
        return (
            f"the delay of {1e3 * delay:.0f} ms exceeds the {1e3 * self.max_delay:.0f} ms that "
            f"{self.law} for {self.vehicle.reference} allows: expect a limit cycle; choose "
            f"--law steering_lead or design for the delay"
        )


def dumps(record: Calibration, tables: Mapping[str, Any]) -> str:
    """Return the text of a calibration file."""
    content: dict[str, Any] = {
        **tables,
        "calibration": {field.name: getattr(record, field.name) for field in fields(Calibration)},
    }
    head = {"schema": SCHEMA, DIGEST: digest(tomllib.loads(tomli_w.dumps(content)))}
    return documents.with_short_lists(tomli_w.dumps(head | content))


def digest(content: Mapping[str, Any]) -> str:
    """Return the SHA-256 of the tables of a file as read, in hexadecimal.

    The solver's time is left out, so that the same design has the same digest. It shows that a file
    was edited; it is no signature, for anyone can compute it again.
    """
    promised = {name: table for name, table in content.items() if name not in OPTIONAL}
    design = promised.get("design", {})
    promised["design"] = {key: value for key, value in design.items() if key != "solve_s"}
    return hashlib.sha256(json.dumps(promised, sort_keys=True).encode()).hexdigest()


def save(path: Path, record: Calibration, tables: Mapping[str, Any]) -> None:
    """Write a calibration file.

    Raises:
        CanrollError: the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(dumps(record, tables), encoding="utf-8")
    except OSError as error:
        raise CanrollError(f"cannot write {path}: {reason(error)}") from error


@checked
def load(path: str | Path) -> LoadedCalibration:
    """Read and check a calibration file.

    Raises:
        CanrollError: unreadable, another schema, a missing, unknown or out-of-range value; one
            line with file, line and key.
    """
    path = Path(path)
    try:
        text = documents.text(path)
    except (OSError, ValueError) as error:
        raise CanrollError(f"cannot read calibration {path}: {reason(error)}") from error
    if not text.strip():
        raise CanrollError(f"{path}: empty file: create it again with 'canroll design'")
    try:
        content = documents.parse_toml(text)
    except ValueError as error:
        raise CanrollError(f"{path}: not a TOML file: {reason(error)}") from error
    documents.refuse_other(content, "calibration", str(path))
    schema = content.pop("schema", None)
    if schema != SCHEMA:
        raise CanrollError(
            f"{path}: schema {schema!r}, but this version reads {SCHEMA}: "
            f"create it again with 'canroll design'"
        )
    given = OPTIONAL & set(content)
    _known(content, TABLES - {"schema"} | given, path, text)
    written = content.pop(DIGEST)
    for name, value in content.items():
        if not isinstance(value, dict):
            raise CanrollError(f"{_at(path, text, name)}: {name} must be a table, [{name}]")
    computed = digest(content)
    integers = content.pop("calibration")
    table = fields(Calibration)
    _known(integers, {field.name for field in table}, path, text)
    for field in table:
        _checked(field, integers[field.name], path, text)
    record = fill(integers)
    expected = getattr(sealed(fill(integers)), RESERVED)
    if getattr(record, RESERVED) != expected:
        raise CanrollError(
            f"{_at(path, text, RESERVED)}: {RESERVED} does not match the fields: the file was "
            f"edited; create it again with 'canroll design'"
        )
    _check_needed(content, path)
    if computed != written:
        raise CanrollError(
            f"{path}: the digest does not match the content: the file was edited; create it again "
            f"with 'canroll design'"
        )
    if own_stage.NAME in content:
        content[own_stage.NAME] = _stage(content[own_stage.NAME], path, text)
    vehicle = vehicles.embedded(
        content[VEHICLE],
        reference=content["design"]["vehicle"],
        fingerprint=content["provenance"]["vehicle_sha256"],
        where=_at(path, text, VEHICLE),
    )
    return LoadedCalibration(record, content, path, vehicle)


def _check_needed(content: Mapping[str, Any], path: Path) -> None:
    for table, kinds in NEEDED.items():
        for key, kind in kinds.items():
            if key not in content[table]:
                raise CanrollError(f"{path}: [{table}] missing key '{key}'")
            if not isinstance(content[table][key], kind):
                wanted = " or ".join(each.__name__ for each in kind)
                raise CanrollError(f"{path}: [{table}] '{key}' must be of type {wanted}")


def _stage(table: Any, path: Path, text: str) -> dict[str, str]:  # noqa: ANN401
    """Return the table of a user's stage with its source, read from its file if it has none."""
    where = _at(path, text, own_stage.NAME)
    if not isinstance(table, dict) or not {"file"} <= set(table) <= {"file", "source"}:
        raise CanrollError(f"{where}: [stage] has the keys file and, if not read from it, source")
    if not all(isinstance(value, str) for value in table.values()):
        raise CanrollError(f"{where}: [stage] file and source are texts")
    if "source" in table:
        return table
    return own_stage.read(path.parent / table["file"]).table()


def _known(
    table: Mapping[str, Any], names: set[str] | frozenset[str], path: Path, text: str
) -> None:
    """Refuse unknown and missing keys."""
    for key in table:
        if key not in names:
            near = get_close_matches(key, sorted(names), n=1, cutoff=0.8)
            hint = f"did you mean '{near[0]}'?" if near else "create it again with 'canroll design'"
            raise CanrollError(f"{_at(path, text, key)}: unknown key '{key}': {hint}")
    missing = sorted(names - set(table))
    if missing:
        raise CanrollError(f"{path}: missing key '{missing[0]}'")


def _checked(field: Field, value: Any, path: Path, text: str) -> None:  # noqa: ANN401
    """Refuse a wrong shape, a non-integer and a value outside the range of the field."""
    items = [value]
    for length in field.shape:
        if any(not isinstance(item, list) or len(item) != length for item in items):
            shape = " x ".join(str(n) for n in field.shape)
            raise CanrollError(f"{_at(path, text, field.name)}: '{field.name}' must be {shape}")
        items = [entry for item in items for entry in item]
    for item in items:
        if isinstance(item, bool) or not isinstance(item, int):
            raise CanrollError(
                f"{_at(path, text, field.name)}: '{field.name}' must hold integers, not {item!r}"
            )
        if not field.f.lo <= item <= field.f.hi:
            raise CanrollError(
                f"{_at(path, text, field.name)}: '{field.name}' = {item} is outside "
                f"{field.f.lo} to {field.f.hi}"
            )


def _at(path: Path, text: str, key: str) -> str:
    """Return ``path:line`` of the last line that sets ``key`` or opens its table."""
    pattern = re.compile(rf"^\s*(\[{re.escape(key)}\]|{re.escape(key)}\s*=)")
    lines = [n for n, line in enumerate(text.splitlines(), 1) if pattern.match(line)]
    return f"{path}:{lines[-1]}" if lines else str(path)
