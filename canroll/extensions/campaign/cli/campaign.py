"""``canroll campaign``: one calibration against many vehicles, buses, noises and faults."""

import argparse
import shlex
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from canroll.cli import cases, terminal
from canroll.cli.options import choices_of, folder_of, scenario
from canroll.cli.run import answer
from canroll.cli.terminal import Part
from canroll.errors import CanrollError, UnknownNameError
from canroll.extensions.campaign import campaign_file, page, store, study
from canroll.extensions.campaign.plan import SIDES, CampaignPlan
from canroll.extensions.campaign.summary import REDUCTION, Summary, order
from canroll.report.console import Console
from canroll.report.run_folder import write_page
from canroll.report.staging import page_folder
from canroll.runs import experiment
from canroll.runs.metrics import BY_KEY

CHUNKS = "campaign"
"""Folder of the chunks in the output folder."""
SUFFIX = ".toml"


def run(args: argparse.Namespace) -> int:
    """Drive all draws, print the tables, write page, JSON and table; 1 if a draw fails."""
    _check(args)
    out = page_folder(folder_of(args))
    if args.only is not None:
        return _one(args, out)
    folder = None if out is None else out / CHUNKS
    kept = None if folder is None or args.resume else store.unfinished(folder)
    if kept:
        raise CanrollError(
            f"{folder} holds an unfinished campaign ({kept} chunks): continue it with --resume, or "
            "choose another --out"
        )
    if folder is not None:
        store.arrow()
    plan = _request(args).plan()
    chunks = None
    if folder is not None:
        chunks = store.opened(folder, plan.digest, plan.description, resume=args.resume)
    return _drive(args, plan, chunks, out)


def _check(args: argparse.Namespace) -> None:
    """Reject invalid options before any slow work."""
    if args.only is not None and args.only < 0:
        raise CanrollError(f"--only must be at least 0, got {args.only}")
    if args.until is not None and not 0 < args.until < 1:
        raise CanrollError(f"--until must be above 0 and below 1, got {args.until:g}")
    if args.worst_by not in (REDUCTION, *BY_KEY):
        raise UnknownNameError("metric of --worst-by", args.worst_by, (REDUCTION, *BY_KEY))
    cases.check(args, folder_of(args))


def _request(args: argparse.Namespace) -> campaign_file.CampaignRequest:
    """Return the campaign of the command line."""
    choices = choices_of(args)
    return study.request(
        args.what if args.what.endswith(SUFFIX) else scenario(args.what),
        choices,
        runs=args.runs,
        seed=choices.get("seed"),
        spread=dict(args.spread),
        buses=choices.pop("bus", []),
        words=("--spread", "--fault", "several --bus"),
    )


def _drive(
    args: argparse.Namespace, plan: CampaignPlan, chunks: store.Chunks | None, out: Path | None
) -> int:
    """Drive the draws of a plan and report."""
    until = None if args.until is None else study.Until(args.event, args.until)
    try:
        with draws(plan.runs, quiet=args.json) as watch:
            means = study.Means(chunks, args.scheduler, args.jobs, watch, worst_by=args.worst_by)
            campaign = study.run(plan, means, until=until)
    except KeyboardInterrupt:
        if chunks is not None:
            kept = len(list(chunks.folder.glob("*.parquet")))
            terminal.note(
                f"{kept} of {plan.chunks} chunks are in {chunks.folder}: continue with --resume"
            )
        raise
    command = command_of(args)
    numbers = campaign.to_json() | {"command": command}
    texts = {"report": (".html", lambda: page.campaign_page(campaign, command, numbers))}
    data = {"files": {}, **write_page(out, "campaign", texts, numbers)}
    if campaign.file is not None:
        data["files"]["table"] = str(campaign.file)
    good = not campaign.summary.fails
    parts: list[Part] = [terminal.verdict(campaign.verdict, good=good)]
    parts += terminal.warnings(campaign.nominal.warnings)
    parts += [page.probability_table(campaign), "", page.quantile_table(campaign), ""]
    if until is not None and not until.reached(campaign.summary):
        parts.append(f"--until {until.width:g} is not reached by {campaign.summary.draws} draws")
    worst = campaign.hardest
    before, after = (worst[f"{side}_roll_max_deg"] for side in SIDES)
    parts.append(
        f"hardest ({order(args.worst_by)}): draw {worst['draw']}, {worst['verdict']}, largest "
        f"roll angle {after:.2f}° instead of {before:.2f}°; "
        f"see it with\n{command} --only {worst['draw']}"
    )
    return terminal.emit(args, data, [*parts, *terminal.files(data["files"])], good=good)


def command_of(args: argparse.Namespace) -> str:
    """Return the command line of a campaign, without what only says how it is driven."""
    kept: list[str] = []
    rest = iter(args.arguments)
    for word in rest:
        name, _, value = word.partition("=")
        if name in ("--json", "--resume"):
            continue
        if name in ("--out", "--jobs", "--scheduler", "--until", "--event", "--only"):
            if not value:
                next(rest, None)
            continue
        kept.append(word)
    return shlex.join(["canroll", *kept])


def _one(args: argparse.Namespace, out: Path | None) -> int:
    """Drive one draw again and report it as a run."""
    plan = _request(args).plan()
    if args.only >= plan.runs:
        raise CanrollError(f"--only {args.only}: the campaign has the draws 0 to {plan.runs - 1}")
    with terminal.progress(quiet=args.json) as progress:
        result = experiment.simulate(plan.draw(args.only), plan.controller, progress=progress)
    return answer(result, out, args)


@contextmanager
def draws(total: int, *, quiet: bool) -> Iterator[Callable[[Summary, int], None]]:
    """Show draws, rate, time left and failures so far on stderr; not on a terminal, as above."""
    console = Console(stderr=True)
    if quiet:
        yield lambda summary, kept: None
        return
    if not console.is_terminal:
        yield terminal.by_the_minute(lambda summary, kept: f"draw {summary.draws} of {total}")
        return
    columns = (
        TextColumn("draw {task.completed:.0f} of {task.total:.0f}"),
        BarColumn(),
        TextColumn("{task.fields[rate]} {task.fields[fails]} fail"),
        TimeRemainingColumn(compact=True),
    )
    with Progress(*columns, console=console, transient=True) as bars:
        task = bars.add_task("", total=total, rate="", fails=0)
        start = time.monotonic()

        def report(summary: Summary, kept: int) -> None:
            rate = (summary.draws - kept) / max(time.monotonic() - start, 1e-9)
            bars.update(
                task, completed=summary.draws, rate=f"{rate:.1f} draws/s", fails=summary.fails
            )

        yield report
