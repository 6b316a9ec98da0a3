"""``canroll faults``: the catalogue of faults, driven and judged."""

import argparse
import json
from collections.abc import Sequence

from canroll.cli import terminal
from canroll.cli.cases import driven
from canroll.cli.options import choices_of
from canroll.report.page import PageTable
from canroll.report.run_folder import write_page
from canroll.report.staging import page_folder
from canroll.studies import fault_study
from canroll.studies.fault_catalogue import CATALOGUE
from canroll.studies.fault_study import Coverage, JudgedFault


def run(args: argparse.Namespace) -> int:
    """Drive the catalogue and print its table; 1 if harm goes undetected that nothing excuses."""
    out = page_folder(args.out)
    with driven(args, out) as cases:
        answer = fault_study.study(
            args.scenario, catalogue=args.catalogue or CATALOGUE, cases=cases, **choices_of(args)
        )
    data = write_page(out, "faults", {}, answer.to_json())
    if args.json:
        print(json.dumps(data))
        return answer.exit_code
    settings = answer.settings
    print(
        f"{settings.scenario.replace('_', ' ')}, {settings.vehicle.name} at "
        f"{settings.speed * 3.6:.0f} km/h, {settings.law_name} with {settings.actuator} over "
        f"{settings.bus_name}"
    )
    terminal.show_verdict(answer.verdict, good=not answer.exit_code)
    print()
    terminal.show_table(coverage_table(answer.coverage))
    others = [f for f in answer.faults if f.as_expected is False and not f.harmful]
    parts: dict[str, Sequence[JudgedFault]] = {
        "Harmful and not detected": answer.undetected,
        "Harmful, detected": [f for f in answer.faults if f.harmful and f.detected],
        "Other than expected": others,
        "No verdict is possible": [f for f in answer.faults if f.no_verdict],
    }
    for title, faults in ({"All faults": answer.faults} if args.all else parts).items():
        if faults:
            print(f"\n{title}:")
            print("\n".join(f"  {line(fault)}" for fault in faults))
    return answer.exit_code


def line(fault: JudgedFault) -> str:
    """Return what happened, in one line."""
    seen = fault.reaction
    if fault.no_verdict or seen is None:
        return f"{fault.entry.name}: {fault.no_verdict}"
    reaction = "not detected"
    if seen.detected_after is not None:
        reaction = f"{seen.detected_by} after {1e3 * seen.detected_after:.0f} ms, {seen.mode}"
    expected = f" (expected: {f'{fault.entry.expect} {fault.entry.mode}'.strip()})"
    harm = "no harm"
    if seen.harm_after is not None:
        harm = f"{'; '.join(seen.harm)}, harm after {1e3 * seen.harm_after:.0f} ms"
    if fault.visibility is not None:
        harm += f"; {fault.visibility.text}"
    return f"{fault.entry.name}: {reaction}{'' if fault.as_expected else expected}; {harm}"


def coverage_table(coverage: Sequence[Coverage]) -> PageTable:
    """Return the diagnostic coverage by group; missed: harmful and not detected."""
    head = ("", "faults", "detected", "harmful", "in time", "missed", "coverage")
    rows = [
        (
            of.group,
            *(str(n) for n in (of.faults, of.detected, of.harmful, of.in_time)),
            str(of.undetected_harm),
            "" if of.coverage is None else f"{100 * of.coverage:.0f} %",
            *("" if t is None else f"{1e3 * t:.0f}" for t in (of.median_s, of.most_s)),
        )
        for of in coverage
    ]
    return PageTable("Diagnostic coverage", (*head, "median (ms)", "most (ms)"), rows)
