"""``canroll timing --hil``: a run in real time, judged by the calibration's budget for the host."""

import argparse
import json
import tempfile
from pathlib import Path

from hil.cli.options import choices_of
from hil.cli.realtime_table import show_timing
from hil.realtime import session
from hil.realtime.budget import budget_of, judge_host
from hil.runs import experiment


def run(args: argparse.Namespace) -> int:
    """Drive the manoeuvre in real time and print the verdicts; 1 where one fails or none holds.

    On a single core nothing is judged: two programs that share it say nothing about the ECU.

    Args:
        args: calibration or law, scenario, duration and json of ``canroll timing``.
    """
    settings, controller = experiment.plan(args.scenario, **choices_of(args))
    limits = budget_of(controller.record, controller.tables)
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
