"""``canroll vehicle``: a vehicle file from mass and size, one beside its class, a tyre file."""

import argparse
from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

import tomli_w

from canroll import vehicles
from canroll.cli.terminal import Part, emit, warnings
from canroll.errors import CanrollError, reason
from canroll.extensions.car.sizing.classes import CLASSES, HEAVIEST, class_named
from canroll.extensions.car.sizing.estimate import SIZES, estimated
from canroll.extensions.car.sizing.review import ReviewedQuantity, beside_class, handling
from canroll.report.page import PageTable
from canroll.vehicles import Vehicle


def run(args: argparse.Namespace) -> int:
    """Write an estimated vehicle, compare one with its class, or fit a tyre."""
    return {"new": _new, "check": _check, "tyre": _tyre}[args.what](args)


def _tyre(args: argparse.Namespace) -> int:
    from canroll.extensions.car.cli import vehicle_tyre  # noqa: PLC0415 - seconds that only a fit needs

    return vehicle_tyre.run(args)


def _new(args: argparse.Namespace) -> int:
    file = Path(args.vehicle)
    if file.suffix != ".toml":
        raise CanrollError(f"{file}: the name of a vehicle file ends in .toml")
    if file.exists():
        raise CanrollError(f"{file} is there already: choose another name, or remove it")
    if args.kind is None:
        raise CanrollError(f"--class is missing: {', '.join(CLASSES)}")
    known = {key: getattr(args, key) for key in SIZES if getattr(args, key) is not None}
    for name in (name for name in SIZES if name not in known):
        raise CanrollError(f"--{name} is missing: a vehicle needs its {name}")
    known |= {key: _number(key, value) for key, value in args.set or ()}
    vehicle = estimated(args.kind, known, name=file.stem, drive=args.drive)
    table = vehicle.document
    # a file without a design has the plant's
    del table["design"]
    try:
        file.write_text(tomli_w.dumps(table), encoding="utf-8")
    except OSError as error:
        raise CanrollError(f"cannot write {file}: {reason(error)}") from error
    origin = Counter(source.split(" ")[0] for source in table["sources"].values())
    more = len(known) - len(SIZES)
    ratios = f" and {more} ratio{'s' * (more > 1)}" if more else ""
    return _emit(
        vehicle,
        args,
        f"\nwritten to {file} from {len(SIZES)} sizes{ratios}: {origin['estimated']} numbers "
        f"estimated with their spread in [sources], {origin['given']} given by these, "
        f"{origin['of']} of {CLASSES[args.kind].base}",
    )


def _number(key: str, value: str) -> float:
    try:
        return float(value)
    except ValueError as error:
        raise CanrollError(f"--set {key}={value}: must be a number") from error


def _check(args: argparse.Namespace) -> int:
    if args.kind is not None:
        class_named(args.kind, args.drive)
    elif args.drive is not None:
        raise CanrollError("--drive: it belongs to a class: add --class, or omit it")
    return _emit(vehicles.load(args.vehicle), args)


def _emit(vehicle: Vehicle, args: argparse.Namespace, *more: str) -> int:
    """Print a vehicle's quantities, with the usual ranges of a class, and further lines."""
    kind = args.kind
    quantities = list(handling(vehicle, kind))
    ratios = [] if kind is None else list(beside_class(vehicle, kind, args.drive))
    data = {
        "vehicle": vehicle.name,
        "class": kind,
        "handling": [asdict(quantity) for quantity in quantities],
        "ratios": [asdict(quantity) for quantity in ratios],
    }
    parts: list[Part] = [vehicle.title]
    parts.append(_table("plausible" if kind is None else "usual", quantities))
    if kind is None:
        parts.append("\nusual ranges of a class: --class " + ", --class ".join(CLASSES))
        return emit(args, data, [*parts, *more])
    unusual = [each.label for each in (*quantities, *ratios) if not each.usual]
    verdict = f"unusual: {', '.join(unusual)}" if unusual else "all numbers are usual"
    parts += [f"\nfor a {CLASSES[kind].title}: {verdict}", _table("usual", ratios)]
    if vehicle.total_mass > HEAVIEST:
        note = f"the ratios are of vehicles up to {1e-3 * HEAVIEST:g} t, lighter than it"
        parts += warnings([note])
    return emit(args, data, [*parts, *more])


def _table(ranges: str, quantities: Iterable[ReviewedQuantity]) -> PageTable:
    return PageTable(
        title="",
        head=("", "value", "", ranges, ""),
        rows=[
            (
                quantity.label,
                f"{quantity.value:.3g}" if quantity.value < 1000 else f"{quantity.value:.0f}",
                quantity.unit,
                "" if quantity.low is None else f"{quantity.low:.3g} to {quantity.high:.3g}",
                "" if quantity.usual else "unusual",
            )
            for quantity in quantities
        ],
    )
