"""``canroll timing``: what a tick costs on the target, judged against the calibration's budget."""

import argparse
import json
from dataclasses import replace

from canroll.errors import CanrollError
from codegen.run import cortex, qemu, unicorn
from codegen.run.backends import Recorder, open_backend
from codegen.run.cortex import CPUS, Run
from codegen.run.ecu_traffic import Traffic
from codegen.run.footprint import Footprint, footprint
from hil.cli import host_timing
from hil.realtime.budget import Budget, budget_of
from hil.runs.experiment import build_world, plan
from hil.runs.frozen import Controller
from hil.runs.virtual_time import closed_loop


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "timing", help="instructions, stack and sizes on the target; budget verdict"
    )
    parser.add_argument("--calibration", help="calibration.toml (default: design one)")
    parser.add_argument("--law", help="law to design (default: the one of 'canroll run')")
    parser.add_argument("--observer", help="observer to design it with")
    parser.add_argument("--scenario", default="double_lane_change", help="manoeuvre to replay")
    parser.add_argument("--duration", type=float, default=5.0, help="s of it (default: 5)")
    parser.add_argument(
        "--identification", action="store_true", help="with run-time identification"
    )
    parser.add_argument(
        "--backend",
        default="cortex-m4",
        choices=tuple(CPUS),
        help="processor (default: %(default)s)",
    )
    parser.add_argument(
        "--counter",
        choices=("qemu", "unicorn"),
        help="what counts (default: qemu where it is installed)",
    )
    parser.add_argument(
        "--hil", action="store_true", help="run in real time and judge tick, latency and misses"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Replay a manoeuvre on the target; return 1 where the budget is exceeded."""
    if args.hil:
        return host_timing.run(args)
    controller, traffic = recorded(args)
    record = controller.record
    counter = args.counter or ("qemu" if cortex.has_gcc_and_qemu() else "unicorn")
    if counter == "qemu" and not cortex.has_gcc_and_qemu():
        raise CanrollError("--counter qemu needs gcc-arm-none-eabi and qemu-system-arm installed")
    replayed = (qemu.replay if counter == "qemu" else unicorn.replay)(record, traffic, args.backend)
    image = (cortex.gcc_image if counter == "qemu" else cortex.zig_image)(args.backend)
    limits = budget_of(record, controller.tables)
    return report(limits, replayed, footprint(image), as_json=args.json)


def recorded(args: argparse.Namespace) -> tuple[Controller, Traffic]:
    """Drive the manoeuvre in virtual time; return the controller and what the ECU received."""
    settings, controller = plan(
        args.scenario,
        calibration=args.calibration,
        law=args.law,
        observer=args.observer,
        identification=args.identification or None,
        duration=args.duration,
    )
    recorder = Recorder(open_backend(settings.backend, controller.record))
    closed_loop(
        build_world(replace(settings), enabled=True),
        recorder,
        tick_ns=round(settings.tick * 1e9),
        duration_ns=round(args.duration * 1e9),
        progress=None,
    )
    return controller, recorder.traffic


def report(limits: Budget, run: Run, size: Footprint, *, as_json: bool) -> int:
    """Print the budget table; return 1 where a budget is exceeded."""
    counts = run.instructions
    budget = limits.instructions or 0
    good = (budget == 0 or int(counts.max()) <= budget) and not size.forbidden
    good = good and size.static == 0
    least, mean, most = int(counts.min()), round(float(counts.mean())), int(counts.max())
    verdict = "PASS" if good else "FAIL"
    if as_json:
        answer = {
            "processor": run.cpu,
            "counter": run.counter,
            "ticks": len(counts),
            "instructions": {"min": least, "mean": mean, "max": most},
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
        print(json.dumps(answer))
        return 0 if good else 1
    rows = {
        "processor": run.cpu,
        "counter": f"{run.counter}, instructions (not cycles)",
        "ticks": len(counts),
        "instructions a tick, min": least,
        "instructions a tick, mean": mean,
        "instructions a tick, max": most,
        "budget, instructions": budget or "none",
        "stack, bytes": run.stack,
        "code, bytes": size.text,
        "constant tables, bytes": size.tables,
        "memory of its own, bytes": size.static,
        "state record, bytes": size.state,
        "calibration record, bytes": size.calibration,
        "heap or floating point": ", ".join(size.forbidden) or "none linked",
        "verdict": verdict,
    }
    width = max(map(len, rows))
    for name, value in rows.items():
        print(f"{name:<{width}}  {value}")
    return 0 if good else 1
