"""``canroll timing``: cost of a tick on the target, compared with the calibration's budget."""

import argparse
import json
import tempfile
from dataclasses import replace
from pathlib import Path

from canroll.errors import CanrollError
from codegen.run import cortex, qemu, unicorn
from codegen.run.backends import Recorder, open_backend
from codegen.run.cortex import Run
from codegen.run.ecu_traffic import Traffic
from codegen.run.footprint import Footprint, footprint
from hil.cli.options import choices_of
from hil.cli.terminal import show_timing
from hil.realtime import session
from hil.realtime.budget import Budget, budget_of, judge_host, judge_target
from hil.runs import experiment
from hil.runs.experiment import build_world, plan
from hil.runs.frozen import Controller
from hil.runs.virtual_time import closed_loop


def run(args: argparse.Namespace) -> int:
    """Replay a manoeuvre on the target; return 1 where the budget is exceeded."""
    if args.hil:
        return run_on_host(args)
    controller, traffic = recorded(args)
    record = controller.record
    counter = args.counter or ("qemu" if cortex.has_gcc_and_qemu() else "unicorn")
    if counter == "qemu" and not cortex.has_gcc_and_qemu():
        raise CanrollError("--counter qemu needs gcc-arm-none-eabi and qemu-system-arm installed")
    replayed = (qemu.replay if counter == "qemu" else unicorn.replay)(
        record, traffic, args.processor
    )
    image = (cortex.gcc_image if counter == "qemu" else cortex.zig_image)(args.processor)
    limits = budget_of(controller.tables)
    return report(limits, replayed, footprint(image), as_json=args.json)


def recorded(args: argparse.Namespace) -> tuple[Controller, Traffic]:
    """Drive the manoeuvre in virtual time; return the controller and what the ECU received."""
    settings, controller = plan(args.scenario, **choices_of(args))
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
    least, mean, most = int(counts.min()), round(float(counts.mean())), int(counts.max())
    affordable = all(verdict.ok for verdict in judge_target(limits, most))
    good = affordable and not size.forbidden and size.static == 0
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
        "budget, instructions": "none" if limits.instructions is None else limits.instructions,
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


def run_on_host(args: argparse.Namespace) -> int:
    """Drive the manoeuvre in real time and print the verdicts; 1 where one fails or none holds.

    On a single core nothing is judged: two programs that share it say nothing about the ECU.

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
    if args.json:
        named = {v.name: {"value": v.value, "limit": v.limit, "ok": v.ok} for v in verdicts}
        verdict = ("PASS" if good else "FAIL") if verdicts else "not judged"
        if invalid:
            verdict = "not valid"
        print(json.dumps({"timing": timing, "verdicts": named, "verdict": verdict}))
    else:
        show_timing(timing)
        print("\n".join(map(str, verdicts)) or "not judged: one core for both programs")
        if invalid:
            print(f"not valid: {'; '.join(invalid)}")
    return 0 if good else 1
