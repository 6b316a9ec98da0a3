"""``canroll design``: a law for a vehicle, verified and written as calibration.toml and C."""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from canroll.cli import design_view, terminal
from canroll.cli.design_parsers import DEFAULT_DELAY_MS
from canroll.cli.options import (
    DEFAULT_OUT,
    choices_of,
)
from canroll.cli.terminal import Part
from canroll.codegen.export.header import gains_header
from canroll.codegen.generated import own_stage
from canroll.errors import CanrollError, writing
from canroll.gain_gen.analysis import loss_of_force
from canroll.gain_gen.analysis.speed_schedule import with_speed_rate
from canroll.gain_gen.calibration import calibration_file
from canroll.gain_gen.calibration.dequantise import physical_notes
from canroll.gain_gen.calibration.summary import summary, title
from canroll.gain_gen.calibration.vehicle_part import actuator_moment
from canroll.gain_gen.models.task import Check, Delay, Design, Task
from canroll.setup.bus_frames import profile_of, stage_of
from canroll.setup.choices import check as check_choices
from canroll.setup.choices import chosen
from canroll.setup.controller import calibrated, options_of, task_of

if TYPE_CHECKING:
    from canroll.gain_gen.monitors.detectability import Detectable


def design_task(args: argparse.Namespace) -> Task:
    """Return the design task that the options describe.

    Raises:
        CanrollError: an unknown vehicle, or invalid delays.
    """
    choices = choices_of(args)
    check_choices(choices)
    task = task_of(choices, delay_of(args))
    return replace(task, gamma_target=args.gamma)


def delay_of(args: argparse.Namespace) -> Delay | None:
    """Return the delay given in ms; None for that of the named bus.

    A ``--dbc`` without ``--bus`` uses the default bus.
    """
    if args.bus is not None or args.dbc is not None:
        return None
    most = 1e-3 * (DEFAULT_DELAY_MS if args.delay is None else args.delay)
    least = most if args.delay_min is None else 1e-3 * args.delay_min
    if not 0.0 <= least <= most:
        raise CanrollError(f"--delay {1e3 * most:g} must not be negative nor below --delay-min")
    return Delay(0.5 * (least + most), least, most)


def run(args: argparse.Namespace) -> int:
    """Design, write and report; 1 for an as-printed law that fails a check, else 0."""
    if args.compare:
        # every law, for a comparison alone
        from canroll.cli.design_comparison import compare  # noqa: PLC0415

        return compare(args, design_task(args))
    choices = choices_of(args)
    stage = stage_of({}, choices)
    task = design_task(args)
    options = options_of(choices, task.vehicle)
    box = options.uncertainty
    answer, record, tables = calibrated(chosen(choices, "law"), task, options)
    answer = with_speed_rate(answer)
    tables = {**tables, "margins": {**tables["margins"], **answer.margins}}
    checks = {name: Check(**entry) for name, entry in tables["verification"].items()}
    of_bus = profile_of(choices).warnings
    warnings = (*of_bus, *tables["design"]["warnings"])
    if task.actuator != "dampers":  # which hold no car up
        warnings += loss_of_force.warnings(task.vehicle, actuator_moment(task))
    answer = replace(answer, verified=checks, warnings=warnings)
    out = args.out or DEFAULT_OUT
    files = [out / "calibration.toml", out / "canroll_gains.h"]
    calibration_file.save(files[0], record, own_stage.added(tables, stage))
    header = gains_header(record, title=title(answer), physical=physical_notes(record))
    with writing(files[1]):
        files[1].write_text(header, encoding="utf-8")
    rows: Sequence[Detectable] = ()
    if args.json or args.verbose or args.uncertainty:
        # the residuals' filters, which take as long to import as all else here
        from canroll.gain_gen.monitors.detectability import of_calibration  # noqa: PLC0415

        rows = of_calibration(record, answer.task, box)
    written = [str(path) for path in files]
    data = summary(answer)
    data |= {"detectability": [row.to_json() for row in rows], "files": written}
    parts: list[Part] = [*shown(answer)]
    parts += ["", design_view.others(answer)] if args.verbose else []
    if args.verbose or args.uncertainty:
        parts += terminal.titled(design_view.detectability(rows, box))
    parts.append(f"written: {', '.join(written)}")
    return terminal.emit(args, data, parts, good=not answer.failures)


def shown(answer: Design) -> Iterator[Part]:
    """Yield gains, checks and warnings of a design."""
    yield from design_view.head(answer)
    yield from ("", design_view.checks(answer.verified))
    yield from design_view.over_draws(answer.margins, answer.max_delay - answer.task.delay.most)
    if not answer.is_verified:
        yield "NOT VERIFIED: written for comparison only"
    yield from terminal.warnings(answer.warnings)
