"""``canroll timing``: cost of a tick on the target, compared with the calibration's budget."""

import argparse
import importlib.util
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from canroll.cli import run_view, terminal
from canroll.cli.options import choices_of
from canroll.codegen.run import cortex, qemu, unicorn
from canroll.codegen.run.bus_firmware import BusFirmware
from canroll.codegen.run.cortex import CortexRun
from canroll.codegen.run.ecu_traffic import EcuTraffic
from canroll.codegen.run.specialised import specialised
from canroll.codegen.worst_case.footprint import Footprint, footprint
from canroll.errors import CanrollError, MissingExtraError
from canroll.firmware.calibration import Calibration
from canroll.hil import session
from canroll.hil.budget import Budget, budget_of, judge_host, judge_target
from canroll.plant_sim.can_bus.network.own_frames import most_received
from canroll.runs import experiment
from canroll.runs.experiment import plan
from canroll.runs.result import Run
from canroll.runs.traffic import record_traffic
from canroll.setup.controller import Controller

if TYPE_CHECKING:
    from canroll.codegen.worst_case.authentication import Authentication


def run(args: argparse.Namespace) -> int:
    """Replay a manoeuvre on the target; return 1 if the budget is exceeded."""
    if args.hil:
        return run_on_host(args)
    if args.bound:
        return run_bound(args)
    settings, controller, traffic = recorded(args)
    record = controller.record
    firmware = chosen(settings.firmware, record, specialise=args.specialise)
    counter = args.counter or ("qemu" if cortex.has_gcc_and_qemu() else "unicorn")
    if counter == "qemu" and not cortex.has_gcc_and_qemu():
        raise CanrollError("--counter qemu needs gcc-arm-none-eabi and qemu-system-arm installed")
    if counter == "qemu":
        flags = cortex.optimisation_of(firmware)
        image = cortex.gcc_image(args.processor, firmware.files, optimisation=flags)
        replayed = qemu.replay(
            record, traffic, args.processor, firmware=firmware, key=settings.secret
        )
    else:
        image = cortex.zig_image(args.processor, firmware)
        replayed = replay_here(args.processor, record, traffic, firmware, settings.secret)
    limits = budget_of(controller.tables)
    return report(args, limits, replayed, footprint(image, firmware.record))


def replay_here(
    processor: str, record: Calibration, traffic: EcuTraffic, firmware: BusFirmware, key: bytes
) -> CortexRun:
    """Replay in this process, with the authentication of a bus that has it."""
    if firmware.bus.secured:
        return unicorn.replay_secured(record, traffic, processor, firmware, key=key)
    return unicorn.replay(record, traffic, processor, firmware)


def chosen(firmware: BusFirmware, record: Calibration, *, specialise: bool) -> BusFirmware:
    """The firmware of a run, for any calibration or for ``record`` alone."""
    return specialised(firmware, record) if specialise else firmware


def run_bound(args: argparse.Namespace) -> int:
    """Print the worst case of a tick and the maximum observed; 1 if the budget is exceeded."""
    if importlib.util.find_spec("capstone") is None:
        raise MissingExtraError("reading machine code", "target")
    from canroll.codegen.worst_case import cycles, firmware_bound  # noqa: PLC0415 - need the extra

    if args.ticks < 1:
        raise CanrollError(f"--ticks must be at least 1, got {args.ticks}")
    if args.clock is not None and not args.clock > 0:
        raise CanrollError(f"--clock must be positive, got {args.clock:g}")
    timing = cycles.Timing(args.processor, args.wait_states, args.multiplier, args.division)
    if not cortex.has_gcc_and_qemu():
        raise CanrollError("--bound needs gcc-arm-none-eabi and qemu-system-arm installed")
    settings, controller, traffic = recorded(args)
    firmware = chosen(settings.firmware, controller.record, specialise=args.specialise)
    received = most_received(settings.profile, firmware.bus, round(controller.tick * 1e9))
    bound = firmware_bound.firmware_bound(controller.record, timing, firmware, received=received)
    with terminal.progress(quiet=args.json) as report_share:
        seen = firmware_bound.observe(
            controller.record,
            traffic,
            timing,
            args.ticks,
            firmware=firmware,
            received=received,
            progress=lambda done: report_share("replay", min(done / args.ticks, 1.0)),
        )
    limits = budget_of(controller.tables)
    good = seen.cycles <= bound.tick.cycles and seen.stack <= bound.tick.stack
    good &= limits.cycles is None or bound.tick.cycles <= limits.cycles
    share = None
    if args.clock is not None:
        share = bound.tick.cycles / (args.clock * 1e6 * controller.tick)
        good &= share <= 1.0
    answer = {
        "processor": timing.cpu,
        "wait_states": timing.wait_states,
        "multiplier": timing.multiplier,
        "division": timing.division,
        "cycles": {"bound": bound.tick.cycles, "seen": seen.cycles},
        "stack": {"bound": bound.tick.stack, "seen": seen.stack},
        "receive": {"cycles": bound.receive.cycles, "stack": bound.receive.stack},
        "authentication": _bound_of_authentication(bound.authentication),
        "ticks": seen.ticks,
        "late_ticks": seen.late,
        "clock_mhz": args.clock,
        "share_of_tick": share,
        "budget_cycles": limits.cycles,
        "functions": bound.tick.shares,
        "verdict": "PASS" if good else "FAIL",
    }
    memory = f"flash with {timing.wait_states} wait states, no interrupts"
    rows = named_rows(
        {
            "processor": f"{timing.cpu}, {memory}",
            "cycles per tick, bound": bound.tick.cycles,
            **_rows_of_authentication(bound.authentication),
            f"cycles per tick, maximum of {seen.ticks}": seen.cycles,
            "bound over maximum seen": f"{bound.tick.cycles / seen.cycles:.2f}",
            "of these after missed ticks": seen.late,
            "share of a tick": "give --clock" if share is None else f"{100 * share:.1f} %",
            "budget, cycles": limits.cycles or "none",
            "stack, bytes, bound": bound.tick.stack,
            "stack, bytes, maximum seen": seen.stack,
            "cycles per received frame, bound": bound.receive.cycles,
            "verdict": answer["verdict"],
        }
    )
    longest = named_rows(dict(list(bound.tick.shares.items())[:8]))
    parts = [*rows, "\nlongest path by function, cycles", *longest]
    return terminal.emit(args, answer, parts, good=good)


def _bound_of_authentication(bound: "Authentication | None") -> dict[str, int] | None:
    if bound is None:
        return None
    return {
        "cycles": bound.cycles,
        "received": bound.received,
        "sent": bound.sent,
        "verify": bound.verify.cycles,
        "protect": bound.protect.cycles,
    }


def _rows_of_authentication(bound: "Authentication | None") -> dict[str, object]:
    if bound is None:
        return {}
    return {
        "of these for authentication": bound.cycles,
        "frames received, bus full": bound.received,
        "frames sent": bound.sent,
        "cycles per verified frame, bound": bound.verify.cycles,
        "cycles per protected frame, bound": bound.protect.cycles,
    }


def named_rows(rows: Mapping[str, object]) -> list[str]:
    """Return names and values as lines in two columns."""
    width = max(map(len, rows))
    return [f"{name:<{width}}  {value}" for name, value in rows.items()]


def recorded(args: argparse.Namespace) -> tuple[Run, Controller, EcuTraffic]:
    """Drive the manoeuvre in virtual time; return what was run and what the ECU received."""
    settings, controller = plan(args.scenario, **choices_of(args))
    return settings, controller, record_traffic(settings, controller, args.duration)


def report(args: argparse.Namespace, limits: Budget, run: CortexRun, size: Footprint) -> int:
    """Print the budget table; return 1 if a budget is exceeded."""
    counts = run.instructions
    least, mean, most = int(counts.min()), round(float(counts.mean())), int(counts.max())
    affordable = all(verdict.ok for verdict in judge_target(limits, most))
    good = affordable and not size.forbidden and size.static == 0
    verdict = "PASS" if good else "FAIL"
    answer = {
        "processor": run.cpu,
        "counter": run.counter,
        "ticks": len(counts),
        "instructions": {"min": least, "mean": mean, "max": most},
        "authentication_instructions": _authentication_json(run),
        "budget_instructions": limits.instructions,
        "bytes": {
            "stack": run.stack,
            "code": size.text,
            "tables": size.tables,
            "static": size.static,
            "state": size.state,
            "calibration": size.calibration,
        },
        "forbidden": list(size.forbidden),
        "verdict": verdict,
    }
    rows = {
        "processor": run.cpu,
        "counter": f"{run.counter}, instructions (not cycles)",
        "ticks": len(counts),
        "instructions per tick, min": least,
        "instructions per tick, mean": mean,
        "instructions per tick, max": most,
        **_authentication_row(run),
        "budget, instructions": "none" if limits.instructions is None else limits.instructions,
        "stack, bytes": run.stack,
        "code, bytes": size.text,
        "constant tables, bytes": size.tables,
        "static memory, bytes": size.static,
        "state record, bytes": size.state,
        "calibration record, bytes": size.calibration,
        "heap or floating point": ", ".join(size.forbidden) or "none linked",
        "verdict": verdict,
    }
    return terminal.emit(args, answer, named_rows(rows), good=good)


def _authentication_json(run: CortexRun) -> dict[str, int] | None:
    cycles = run.authentication
    return (
        None if cycles is None else {"mean": round(float(cycles.mean())), "max": int(cycles.max())}
    )


def _authentication_row(run: CortexRun) -> dict[str, str]:
    if run.authentication is None:
        return {}
    mean, most = run.authentication.mean(), run.authentication.max()
    return {"of these for authentication": f"{mean:.0f} on average, at most {most}"}


def run_on_host(args: argparse.Namespace) -> int:
    """Drive the manoeuvre in real time and print the verdicts; 1 if one fails or none holds.

    On a single core nothing is judged: two programs sharing it do not represent the ECU.

    Args:
        args: calibration or law, scenario, duration and json of ``canroll timing``.
    """
    settings, controller = experiment.plan(args.scenario, **choices_of(args))
    limits = budget_of(controller.tables)
    with tempfile.TemporaryDirectory(prefix="canroll-") as scratch:
        setup = session.Setup(
            bus_options=(),
            folder=Path(scratch),
            cores=session.choose_cores(),
            duration=args.duration,
            announce=lambda text: None,
        )
        _, timing = session.drive(settings, controller, setup, enabled=True)
    del timing["jitterdebugger"]
    verdicts = judge_host(limits, timing)
    invalid = timing["not_valid"]
    good = not invalid and all(verdict.ok for verdict in verdicts)
    named = {v.name: {"value": v.value, "limit": v.limit, "ok": v.ok} for v in verdicts}
    verdict = ("PASS" if good else "FAIL") if verdicts else "not judged"
    data = {"timing": timing, "verdicts": named, "verdict": "not valid" if invalid else verdict}
    parts = [*run_view.timing(timing)]
    parts += map(str, verdicts) if verdicts else ["not judged: one core for both programs"]
    parts += [f"not valid: {'; '.join(invalid)}"] if invalid else []
    return terminal.emit(args, data, parts, good=good)
