"""``canroll campaign``: one calibration against many vehicles, buses, noises and faults."""

import argparse
import json
import shlex
from pathlib import Path
from typing import Any

from canroll.campaigns import campaign_file, page, store, study
from canroll.campaigns.events import EVENTS
from canroll.campaigns.plan import SIDES, CampaignPlan
from canroll.campaigns.splitting import Splitting
from canroll.campaigns.summary import REDUCTION, order
from canroll.cli import cases, terminal
from canroll.cli.main import parse
from canroll.cli.options import DEFAULT_SCENARIO, choices_of, folder_of, scenario
from canroll.cli.run import answer
from canroll.cli.study_parsers import DEFAULT_DRAWS
from canroll.errors import CanrollError, UnknownNameError
from canroll.registry import Registry
from canroll.report.run_folder import write_page
from canroll.report.staging import page_folder, usable_folder
from canroll.runs import conditions, experiment
from canroll.runs.metrics import BY_KEY
from canroll.setup.choice import several
from canroll.setup.choices import CHOICES
from canroll.studies import variation
from plant_sim.driving import MANEUVERS

CHUNKS = "campaign"
"""Folder of the chunks in the output folder."""
MERGE = "merge"
SUFFIX = ".toml"


def run(args: argparse.Namespace) -> int:
    """Drive all draws, print the tables, write page, JSON and table; 1 if a draw fails."""
    if args.what[:1] == [MERGE]:
        return _merge(args)
    _check(args)
    out = page_folder(folder_of(args))
    if args.only is not None:
        return _one(args, out)
    name = CHUNKS if args.rare is None else f"{CHUNKS}-{args.rare}"
    folder = None if out is None else out / name
    kept = None if folder is None or args.resume else store.unfinished(folder)
    if kept and args.shard is None:
        raise CanrollError(
            f"{folder} holds an unfinished campaign ({kept} chunks): continue it with --resume, or "
            "choose another --out"
        )
    if folder is not None:
        store.arrow()
    plan = _request(args).plan()
    if args.rare is not None:
        return _rare(args, plan, folder)
    chunks = None if folder is None else _opened(args, plan, folder)
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
    if args.shard is not None and folder_of(args) is None:
        raise CanrollError("--shard needs the folder for its chunks: add --out")


def _request(args: argparse.Namespace) -> campaign_file.CampaignRequest:
    """Return the campaign of the command line."""
    choices = choices_of(args)
    seed = choices.pop("seed", None)
    faults = conditions.fault_texts(choices)
    for name in ("faults", "fault_file"):
        choices.pop(name, None)
    buses = choices.pop("bus", [])
    if buses:
        choices["bus"] = buses[0]
    if len(args.what) > 1:
        raise CanrollError(f"one manoeuvre or campaign file, got {' '.join(args.what)}")
    what = args.what[0] if args.what else DEFAULT_SCENARIO
    if what.endswith(SUFFIX):
        for option, given in (
            ("--spread", bool(args.spread)),
            ("--fault", bool(faults)),
            ("several --bus", len(buses) > 1),
        ):
            if given:
                raise CanrollError(f"{option}: write what is drawn into {what}")
        return campaign_file.load(Path(what), choices, runs=args.runs, seed=seed)
    return campaign_file.of_options(
        scenario(what),
        choices,
        runs=DEFAULT_DRAWS if args.runs is None else args.runs,
        seed=CHOICES["seed"].default if seed is None else seed,
        spread=variation.spread_from(dict(args.spread)),
        stated=tuple(dict(args.spread)),
        buses=buses,
        faults=faults,
    )


def _opened(args: argparse.Namespace, plan: CampaignPlan, folder: Path) -> store.Chunks:
    return store.opened(
        folder,
        plan.digest,
        {**plan.description, store.ARGUMENTS: args.arguments},
        resume=args.resume or args.shard is not None,
    )


def _means(
    args: argparse.Namespace, chunks: store.Chunks | None, watch: study.Watch
) -> study.Means:
    return study.Means(chunks, args.scheduler, args.jobs, watch, worst_by=args.worst_by)


def _drive(
    args: argparse.Namespace, plan: CampaignPlan, chunks: store.Chunks | None, out: Path | None
) -> int:
    """Drive the draws of a plan and report."""
    until = None if args.until is None else study.Until(args.event, args.until)
    total = plan.runs if args.shard is None else -(-plan.runs // args.shard[1])
    try:
        with terminal.draws(total, quiet=args.json) as watch:
            means = _means(args, chunks, watch)
            if args.shard is not None:
                assert chunks is not None
                count = study.run_shard(plan, means, args.shard)
                first, of = args.shard
                about = {"shard": f"{first}/{of}", "chunks": count, "folder": str(chunks.folder)}
                text = f"shard {first} of {of}: {count} chunks in {chunks.folder}"
                print(json.dumps(about) if args.json else text)
                return 0
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
    if args.json:
        print(json.dumps(data))
        return 1 if campaign.summary.fails else 0
    terminal.show_verdict(campaign.verdict, good=not campaign.summary.fails)
    terminal.show_warnings(campaign.nominal.warnings)
    for table in (page.probability_table(campaign), page.quantile_table(campaign)):
        terminal.show_table(table)
        print()
    if until is not None and not until.reached(campaign.summary):
        print(f"--until {until.width:g} is not reached by {campaign.summary.draws} draws")
    worst = campaign.hardest
    before, after = (worst[f"{side}_roll_max_deg"] for side in SIDES)
    print(
        f"hardest ({order(args.worst_by)}): draw {worst['draw']}, {worst['verdict']}, largest "
        f"roll angle {after:.2f}° instead of {before:.2f}°; "
        f"see it with\n{command} --only {worst['draw']}"
    )
    terminal.show_files(data["files"])
    return 1 if campaign.summary.fails else 0


def command_of(args: argparse.Namespace) -> str:
    """Return the command line of a campaign, without what only says how it is driven."""
    kept: list[str] = []
    rest = iter(args.arguments)
    for word in rest:
        name, _, value = word.partition("=")
        if name in ("--json", "--resume"):
            continue
        if name in ("--out", "--jobs", "--shard", "--scheduler", "--until", "--event", "--only"):
            if not value:
                next(rest, None)
            continue
        kept.append(word)
    return shlex.join(["canroll", *kept])


def _one(args: argparse.Namespace, out: Path | None) -> int:
    """Drive one draw again and report it as a run."""
    plan = _request(args).plan()
    if args.rare is not None:
        if out is None:
            raise CanrollError("--only with --rare reads the samples of --out: add it")
        splitting = Splitting(plan, args.rare, args.samples)
        settings = splitting.sample(out / f"{CHUNKS}-{args.rare}", args.only)
    elif args.only < plan.runs:
        settings = plan.draw(args.only)
    else:
        raise CanrollError(f"--only {args.only}: the campaign has the draws 0 to {plan.runs - 1}")
    with terminal.progress(quiet=args.json) as progress:
        result = experiment.simulate(settings, plan.controller, progress=progress)
    return answer(result, out, args)


def _rare(args: argparse.Namespace, plan: CampaignPlan, folder: Path | None) -> int:
    """Estimate the probability of a rare event, and report it."""
    splitting = Splitting(plan, args.rare, args.samples)
    splitting.check()
    chunks = None
    if folder is not None:
        about = {**splitting.description, store.ARGUMENTS: args.arguments}
        chunks = store.opened(folder, splitting.digest, about, resume=args.resume)
    label = EVENTS[args.rare].label
    with terminal.progress(quiet=args.json) as progress:
        estimate = splitting.run(
            study.Means(chunks, args.scheduler, args.jobs),
            lambda count, level: progress(label, min(level, 1.0)),
        )
    low, high = estimate.interval
    data = {
        "event": args.rare,
        "probability": estimate.probability,
        "low": low,
        "high": high,
        "variation": estimate.variation,
        "runs": estimate.runs,
        "levels": [{"level": level, "share": share} for level, share in estimate.levels],
        "command": command_of(args),
        "table": None if chunks is None else str(store.table_of(chunks.folder)),
    }
    if args.json:
        print(json.dumps(data))
        return 0
    if not estimate.probability:
        print(f"{label}: not reached; its probability is below about {high:.0e}")
    else:
        print(
            f"{label}: probability {estimate.probability:.2e}, 95 % from {low:.2e} to {high:.2e}, "
            f"by {estimate.runs} samples on {len(estimate.levels)} levels"
        )
    if chunks is not None and estimate.probability:
        first = splitting.first_event(chunks.folder)
        print(
            f"see one with\n{command_of(args)} --out {args.out or folder_of(args)} --only {first}"
        )
        terminal.show_files({"table": data["table"]})
    return 0


def _merge(args: argparse.Namespace) -> int:
    """Merge the chunks of shards, and report as one campaign."""
    folders = [Path(text) / CHUNKS for text in args.what[1:]]
    if not folders:
        raise CanrollError("merge: name the --out folders of the shards")
    arguments = store.plan_in(folders[0]).get(store.ARGUMENTS)
    if (
        not isinstance(arguments, list)
        or not all(isinstance(word, str) for word in arguments)
        or arguments[:1] != ["campaign"]
    ):
        raise CanrollError(f"{folders[0]}: plan.json records no command line: run a shard again")
    planned = parse(arguments)
    registries: dict[str, Registry[Any]] = {"what": MANEUVERS}
    registries |= {c.name: c.extensible for c in CHOICES.values() if c.extensible is not None}
    for name, registry in registries.items():
        for value in several(getattr(planned, name) or ()):
            registry.refuse_code(value, str(folders[0] / store.PLAN))
    planned.out, planned.json, planned.jobs = args.out, args.json, args.jobs
    planned.shard, planned.resume = None, True
    plan = _request(planned).plan()
    for folder in folders:
        if store.plan_in(folder).get("digest") != plan.digest:
            raise CanrollError(
                f"{folder}: another campaign than {folders[0]}, or the calibration, vehicle or "
                "version of canroll has changed since"
            )
    out = usable_folder(args.out or Path("out"))
    planned.out = out
    chunks = _opened(planned, plan, out / CHUNKS)
    study.merge(folders, chunks, plan)
    return _drive(planned, plan, chunks, out)
