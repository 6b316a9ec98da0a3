"""``canroll export-c DIR``: the controller as C99 with test vectors, for a firmware project."""

import argparse
import os
from collections.abc import Iterator
from contextlib import contextmanager
from errno import EACCES, ENOTDIR
from pathlib import Path

import numpy as np

from canroll.cli.design_parsers import OF_AN_EXPORT
from canroll.cli.options import choices_of, chosen_services
from canroll.cli.terminal import show, warnings
from canroll.codegen.export import a2l, bundle, prefix
from canroll.codegen.export.header import gains_header
from canroll.codegen.generated import signals
from canroll.codegen.generated.bus_map import load as load_map
from canroll.codegen.run import ecu_traffic, memory_image
from canroll.codegen.run.ecu_traffic import EcuTraffic
from canroll.codegen.run.service import SERVICES
from canroll.dbc.reader import paths_of
from canroll.errors import CanrollError, writing
from canroll.gain_gen.calibration import calibration_file
from canroll.gain_gen.calibration.dequantise import physical_notes
from canroll.gain_gen.calibration.record import identify
from canroll.runs.experiment import plan
from canroll.runs.result import Run
from canroll.runs.traffic import record_traffic
from canroll.setup.bus_frames import refuse_idle, refuse_wide_steps
from canroll.setup.controller import Controller

HOSTILE_TICKS = 200
RECORDED_S = 3.0
"""Length of the recorded run."""


def run(args: argparse.Namespace) -> int:
    """Write the bundle, or only its A2L if an image is given."""
    if args.address is not None:
        memory_image.check_address(args.address)
    prefix.checked(args.prefix)
    if args.elf is not None:
        return address(args.folder, args.elf, args.calibration)
    with writing_to(args.folder):
        refuse_unwritable(args.folder)
    if (args.dbc is None) != (args.map is None):
        raise CanrollError("--dbc and --map require each other")
    if args.dbc is not None:
        bundle.refuse_namesakes(paths_of(args.dbc))
    heard = [name for name in chosen_services(args) if SERVICES[name].start]
    for name in heard if args.dbc is not None else ():
        if SERVICES[name].hears(load_map(paths_of(args.dbc), Path(args.map))) is None:
            raise CanrollError(
                f"--{name}: {args.map} has no table [{name}] with the identifiers: add it"
            )
    settings, controller = plan(
        "double_lane_change",
        **choices_of(args, OF_AN_EXPORT),
        duration=3.0,
    )
    verified = controller.exportable(unverified=args.unverified)
    show(warnings(controller.warnings))
    export = described(args, settings, controller, verified=verified)
    with writing_to(args.folder):
        written = bundle.write(args.folder, export)
        if args.address is not None:
            written += memory_image.write_flash(
                args.folder, export.record, args.address, export.byte_order
            )
    print(f"{len(written)} files in {args.folder}; next: make -C {args.folder} test")
    return 0


@contextmanager
def writing_to(folder: Path) -> Iterator[None]:
    """Report file-system errors in one line."""
    with writing(f"to {folder}", "choose another folder"):
        yield


def refuse_unwritable(folder: Path) -> None:
    """Raise CanrollError for an unwritable folder before designing; leave no new folder behind."""
    there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not there.is_dir():
        raise NotADirectoryError(ENOTDIR, os.strerror(ENOTDIR))
    if not os.access(there, os.W_OK):
        raise PermissionError(EACCES, os.strerror(EACCES))


def described(
    args: argparse.Namespace, settings: Run, controller: Controller, *, verified: bool
) -> bundle.Export:
    """Contents of the bundle."""
    record = controller.record
    title = (
        f"{controller.law} for {controller.vehicle.name}, {controller.actuator}, tick "
        f"{1e3 * controller.tick:g} ms; {'verified' if verified else 'NOT VERIFIED'}."
    )
    if args.dbc is not None:
        bus = load_map(paths_of(args.dbc), Path(args.map))
        refuse_idle(bus, record, str(args.map))
        show(warnings(bus.warnings))
        if record.e2e and not bus.protected:
            record.e2e = 0
            identify(record)
        refuse_wide_steps(bus, record, str(args.map))
        traffic = ecu_traffic.random_traffic(1, HOSTILE_TICKS, bus=bus)
        origin = (
            f"The vectors are {traffic.ticks} ticks of random frames, some with wrong checksums, "
            "counters and lengths."
        )
    else:
        run_in = record_traffic(settings, controller, RECORDED_S)
        hostile = ecu_traffic.random_traffic(1, HOSTILE_TICKS, bus=settings.firmware.bus)
        traffic = joined(run_in, hostile)
        origin = (
            f"The vectors are {run_in.ticks} ticks of a double lane change, then {HOSTILE_TICKS} "
            "of frames with wrong checksums, counters, lengths and values."
        )
    return bundle.Export(
        record=record,
        gains=gains_header(record, title=[title], physical=physical_notes(record)),
        title=title,
        dbc=paths_of(args.dbc or settings.profile.dbc or signals.DBC),
        map_file=Path(args.map or settings.profile.map_file or signals.MAP),
        traffic=traffic,
        origin=origin,
        stage=controller.stage,
        specialised=args.specialise,
        services=chosen_services(args),
        byte_order=args.byte_order or "little",
        measured=True,
        prefix=args.prefix,
    )


def joined(first: EcuTraffic, second: EcuTraffic) -> EcuTraffic:
    """Concatenate recorded traffic."""
    later = second.frames.copy()
    later["tick"] += first.ticks
    return EcuTraffic(
        np.concatenate([first.frames, later]), np.concatenate([first.elapsed, second.elapsed])
    )


def address(folder: Path, elf: Path, calibration: str | None) -> int:
    """Rewrite the A2L with an image's addresses; write the calibration's hex files."""
    if not elf.is_file():
        raise CanrollError(f"{elf}: no such image: build it or omit --elf")
    path = bundle.description(folder)
    if calibration is not None and bundle.is_specialised(folder):
        raise CanrollError(
            f"{folder}: is specialised for one calibration: omit --calibration, or export again"
        )
    image = a2l.image(elf)
    base = image.addresses
    missing = sorted(set(a2l.RECORDS) - set(base))
    if missing:
        raise CanrollError(
            f"{elf}: has no symbol {' and '.join(missing)}; name the records accordingly"
        )
    with writing_to(folder):
        text = a2l.located(path.read_text(encoding="utf-8"), base)
        path.write_text(a2l.ordered(text, image.byte_order), encoding="utf-8")
        if calibration is not None:
            record = calibration_file.load(Path(calibration)).record
            for written in memory_image.write_flash(
                folder, record, base["calibration"], image.byte_order
            ):
                print(written)
    print(f"{path}: {', '.join(f'{n} at {a:#x}' for n, a in base.items())}")
    return 0
