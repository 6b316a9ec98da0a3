"""``canroll faults``: a catalogue of faults or attacks, driven and judged."""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from canroll.cli import terminal
from canroll.cli.cases import driven
from canroll.cli.options import choices_of
from canroll.cli.terminal import Part
from canroll.extensions.campaign.attacks import suite
from canroll.extensions.campaign.attacks.suite import AttackOutcome, Suite
from canroll.extensions.campaign.cli.options import ATTACKS
from canroll.extensions.campaign.faults import study as fault_study
from canroll.extensions.campaign.faults.catalogue import CATALOGUE
from canroll.extensions.campaign.faults.study import Coverage, JudgedFault
from canroll.report.page import PageTable
from canroll.report.run_folder import write_page
from canroll.report.staging import page_folder

BUSES = ("500k", "secured_fd")
"""The buses that are attacked where none is chosen: without authentication and with it."""
HEAD = (
    *("", "sent", "accepted", "refused", "roll max (deg)", "wrong side (N·m)", "for (s)"),
    "fault codes",
)


def run(args: argparse.Namespace) -> int:
    """Drive the catalogue and print its table; 1 if harm goes undetected that nothing excuses."""
    out = page_folder(args.out)
    if str(args.catalogue) == ATTACKS:
        return attacks(args, out)
    with driven(args, out) as cases:
        answer = fault_study.study(
            args.scenario, catalogue=args.catalogue or CATALOGUE, cases=cases, **choices_of(args)
        )
    data = write_page(out, "faults", {}, answer.to_json())
    return terminal.emit(args, data, _parts(answer, every=args.all), good=not answer.exit_code)


def _parts(answer: fault_study.FaultStudy, *, every: bool) -> Iterator[Part]:
    """Yield the verdict, the coverage, and what happened: of the worst faults, or of all."""
    settings = answer.settings
    yield (
        f"{settings.scenario.replace('_', ' ')}, {settings.vehicle.name} at "
        f"{settings.speed * 3.6:.0f} km/h, {settings.law_name} with {settings.actuator} over "
        f"{settings.bus_name}"
    )
    yield terminal.verdict(answer.verdict, good=not answer.exit_code)
    yield from ("", coverage_table(answer.coverage))
    others = [f for f in answer.faults if f.as_expected is False and not f.harmful]
    parts: dict[str, Sequence[JudgedFault]] = {
        "Harmful and not detected": answer.undetected,
        "Harmful, detected": [f for f in answer.faults if f.harmful and f.detected],
        "Other than expected": others,
        "No verdict is possible": [f for f in answer.faults if f.no_verdict],
    }
    for title, faults in ({"All faults": answer.faults} if every else parts).items():
        if faults:
            yield f"\n{title}:"
            yield from (f"  {line(fault)}" for fault in faults)


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
    if fault.by_reaction:
        harm += "; by the reaction: without it no harm"
    if fault.visibility is not None:
        harm += f"; {fault.visibility.text}"
    return f"{fault.entry.name}: {reaction}{'' if fault.as_expected else expected}; {harm}"


def coverage_table(coverage: Sequence[Coverage]) -> PageTable:
    """Return the diagnostic coverage by group; missed: not detected; reaction: harm by it alone."""
    head = ("", "faults", "detected", "harmful", "in time", "missed", "reaction", "coverage")
    rows = [
        (
            of.group,
            *(str(n) for n in (of.faults, of.detected, of.harmful, of.in_time)),
            str(of.undetected_harm),
            str(of.by_reaction),
            "" if of.coverage is None else f"{100 * of.coverage:.0f} %",
            *("" if t is None else f"{1e3 * t:.0f}" for t in (of.median_s, of.most_s)),
        )
        for of in coverage
    ]
    return PageTable("Diagnostic coverage", (*head, "median", "most (ms)"), rows)


def attacks(args: argparse.Namespace, out: Path | None) -> int:
    """Drive all attacks and print their tables; 1 if one gets through authentication."""
    with driven(args, out) as cases:
        suites = [
            suite.run(args.scenario, named=args.attack, cases=cases, **choices)
            for choices in chosen(choices_of(args))
        ]
    good = not any(each.broken for each in suites)
    data = write_page(out, ATTACKS, {}, {"suites": [each.to_json() for each in suites]})
    parts: list[Part] = []
    for each in suites:
        judged = not each.broken if each.authenticated else None
        table = PageTable("", HEAD, list(rows(each)))
        parts += [terminal.verdict(each.verdict, good=judged), table, ""]
    return terminal.emit(args, data, parts, good=good)


def chosen(choices: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the choices of each suite: of the bus chosen, or of both by default."""
    if "bus" in choices or "dbc" in choices:
        return [choices]
    plain, secured = BUSES
    without_key = {name: value for name, value in choices.items() if name != "key"}
    return [{**without_key, "bus": plain}, {**choices, "bus": secured}]


def rows(suite: Suite) -> Iterator[tuple[str, ...]]:
    """Yield a row for each attack, and one for the vehicle without control."""
    yield from map(row, suite.outcomes)
    yield ("without control", "", "", "", f"{suite.passive_roll_deg:.2f}", "", "", "")


def row(outcome: AttackOutcome) -> tuple[str, ...]:
    """What an attack did, as cells."""
    codes = ", ".join(outcome.codes)
    return (
        outcome.attack,
        str(outcome.sent),
        str(outcome.accepted),
        "" if outcome.refused is None else str(sum(outcome.refused)),
        f"{outcome.roll_max_deg:.2f}",
        f"{outcome.wrong_side_max_nm:.0f}",
        f"{outcome.wrong_side_s:.2f}",
        codes,
    )
