"""A campaign as a TOML file: the run, what is drawn, and how often."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

from canroll import documents
from canroll.errors import CanrollError, UnknownNameError, reason
from canroll.extensions.campaign import quantities
from canroll.extensions.campaign.distributions import (
    Discrete,
    Distribution,
    evenly,
    is_number,
    read,
)
from canroll.extensions.campaign.plan import CampaignPlan
from canroll.extensions.campaign.quantities import FAULTS, GROUPS
from canroll.extensions.campaign.space import (
    RANDOM,
    SAMPLINGS,
    SOBOL,
    Correlation,
    Sampling,
    Space,
    check_correlations,
)
from canroll.plant_sim.bodies import own_body
from canroll.plant_sim.buses import BUSES
from canroll.plant_sim.driving import MANEUVERS
from canroll.registry import Registry
from canroll.runs.experiment import plan as plan_run
from canroll.setup.choices import CHOICES, PASSIVE
from canroll.studies.variation import CONDITIONS

SCHEMA = 1
CHUNK = 64
"""Draws of a chunk by default, at most: some seconds of one process."""
CHUNKS = 16
"""Chunks of a small campaign by default, at least: there is work for several processes."""
CHUNK_MOST = 4096
RUNS_MOST = 10**9
SEED_MOST = 2**31 - 1
KEYS = ("schema", "scenario", "runs", "seed", "sampling", "chunk")
TABLES = ("run", "draw", "faults", "correlation")
OWN = ("seed", "duration", "faults", "fault_file")
"""Choices of a run that a campaign has its own keys for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignRequest:
    """A campaign as it was written.

    Attributes:
        scenario: nominal manoeuvre.
        choices: of the nominal run, see :class:`canroll.setup.choices.Choices`.
        draw: distribution of each quantity, by name.
        places: where each quantity is written, for messages.
        correlations: of the quantities.
        runs: number of draws.
        sampling: how they are drawn.
        usual: names in ``draw`` of the vehicle's usual spread, which a fit replaces.
        source: the file, or how the command line is referred to.
    """

    scenario: str
    choices: Mapping[str, Any]
    draw: Mapping[str, Distribution]
    places: Mapping[str, str]
    correlations: tuple[Correlation, ...] = ()
    runs: int
    sampling: Sampling
    usual: Collection[str] = ()
    source: str = "campaign"

    def plan(self) -> CampaignPlan:
        """Return the plan: the controller designed, every quantity checked.

        Raises:
            CanrollError: an invalid name or number; the message names file and key.
            VerdictError: the design fails its own checks.
        """
        if self.choices.get("law") == PASSIVE:
            raise CanrollError("--law passive has no control to evaluate: choose another law")
        if "speed" in self.draw and "speed_kmh" in self.draw:
            raise CanrollError(f"{self.places['speed']}: draw speed or speed_kmh, not both")
        settings, controller = plan_run(self.scenario, **self.choices)
        own_body(settings.plant, "a campaign, which varies its vehicle,")
        fitted, pairs = quantities.of_fit(settings.vehicle)
        given = {n: d for n, d in self.draw.items() if not (fitted and n in self.usual)}
        drawn = given | fitted
        names = tuple(sorted(drawn))
        space = Space(names, tuple(drawn[n] for n in names), (*self.correlations, *pairs))
        check_correlations(space, f"{self.source} [[correlation]]")
        for name, distribution in sorted(given.items()):
            quantities.check(settings, name, distribution, self.places[name])
            if quantities.is_of_fit(settings.vehicle, name):
                raise CanrollError(
                    f"{self.places[name]}: {name} is drawn from [fit] of the vehicle: omit it"
                )
        return CampaignPlan(settings, controller, space, self.sampling, self.runs)


def of_options(
    scenario: str,
    choices: Mapping[str, Any],
    *,
    runs: int,
    seed: int,
    spread: Mapping[str, float],
    buses: Sequence[str],
    faults: Sequence[str],
    stated: Collection[str] = (),
) -> CampaignRequest:
    """Return the campaign given by options of the command line.

    Args:
        scenario: the manoeuvre.
        choices: of the nominal run.
        runs: number of draws.
        seed: of the draws.
        spread: half-widths, see :mod:`canroll.studies.variation`.
        buses: profiles to draw from evenly; one or none: the run's own.
        faults: faults, of which one or none is drawn.
        stated: names in ``spread`` that are meant for a fitted vehicle too, whose numbers are drawn
            from its fit instead of their usual spread.

    Raises:
        CanrollError: an invalid number.
    """
    given = choices.get("conditions") or {}
    draw: dict[str, Distribution] = {}
    for name, share in spread.items():
        centre = 0.0 if name in CONDITIONS else 1.0
        if share and name not in given:
            ends = [centre - share, centre + share]
            draw[_quantity(name)] = read({"uniform": ends}, f"--spread {name}")
    if len(buses) > 1:
        draw["bus"] = evenly(buses)
    if faults:
        single = len(faults) / (len(faults) + 1)
        draw[FAULTS] = fault_sets(faults, single, 0.0)
    return CampaignRequest(
        scenario=scenario,
        choices=choices,
        draw=draw,
        usual={_quantity(name) for name in spread if name not in (*CONDITIONS, "speed", *stated)},
        places=dict.fromkeys(draw, "--spread") | {"bus": "--bus", FAULTS: "--fault"},
        runs=_whole(runs, "--runs", 1, RUNS_MOST),
        sampling=Sampling(RANDOM, seed, _chunk(runs)),
    )


def _quantity(name: str) -> str:
    """Return the name of a quantity of ``--spread``."""
    if name == "speed":
        return name
    return f"condition.{name}" if name in CONDITIONS else f"vehicle.{name}"


def fault_sets(faults: Sequence[str], single: float, double: float) -> Discrete:
    """Return the distribution of the faults of a draw: none, one, or two different ones."""
    sets: list[tuple[str, ...]] = [()]
    shares = [1.0 - single - double]
    for count, share in ((1, single), (2, double)):
        chosen = list(combinations(faults, count)) if share > 0.0 else []
        sets += chosen
        shares += [share / len(chosen) for _ in chosen]
    return Discrete(tuple(sets), tuple(shares))


def load(
    path: Path, choices: Mapping[str, Any], *, runs: int | None, seed: int | None
) -> CampaignRequest:
    """Return the campaign of a file; ``choices``, ``runs`` and ``seed`` replace those in it.

    Raises:
        CanrollError: unreadable, or an invalid key or value; the message names both.
    """
    try:
        table = documents.toml(path)
    except (OSError, ValueError) as error:
        raise CanrollError(f"{path}: not a campaign file ({reason(error)})") from error
    documents.refuse_unknown(table, (*KEYS, *TABLES), f"key of {path}:")
    run, drawn, faults = (_table(table, key, path) for key in ("run", "draw", "faults"))
    if table.get("schema") != SCHEMA:
        raise CanrollError(f"{path}: needs schema = {SCHEMA}")
    scenario = table.get("scenario")
    if not isinstance(scenario, str) or scenario not in MANEUVERS:
        raise UnknownNameError(f"scenario of {path}:", str(scenario), MANEUVERS)
    MANEUVERS.refuse_code(scenario, str(path))
    method = table.get("sampling", RANDOM)
    if method not in SAMPLINGS:
        raise UnknownNameError(f"sampling of {path}:", str(method), SAMPLINGS)
    count = _whole(table.get("runs") if runs is None else runs, f"{path}: runs", 1, RUNS_MOST)
    chunk = _whole(table.get("chunk", _chunk(count)), f"{path}: chunk", 1, CHUNK_MOST)
    if method == SOBOL and chunk & (chunk - 1):
        raise CanrollError(f"{path}: chunk = {chunk}: must be a power of two with sampling sobol")
    first = table.get("seed", 0) if seed is None else seed
    draw = {name: read(value, f"{path} [draw] {name}") for name, value in _flat(drawn)}
    places = {name: f"{path} [draw] {name}" for name in draw}
    registries: dict[str, Registry[Any]] = {"scenario": MANEUVERS, "bus": BUSES}
    for name, registry in registries.items():
        for value in draw[name].extremes() if name in draw else ():
            registry.refuse_code(value, places[name])
    if FAULTS in draw:
        raise CanrollError(f"{path} [draw] faults: faults have their own table [faults]")
    if "faults" in table:
        draw[FAULTS] = _faults(faults, f"{path} [faults]")
        places[FAULTS] = f"{path} [faults] of"
    return CampaignRequest(
        scenario=scenario,
        choices={**_choices(run, f"{path} [run]"), **choices},
        draw=draw,
        places=places,
        correlations=tuple(_correlations(table.get("correlation", []), path)),
        runs=count,
        sampling=Sampling(method, _whole(first, f"{path}: seed", 0, SEED_MOST), chunk),
        source=str(path),
    )


def _chunk(runs: int) -> int:
    """Return the draws of a chunk by default: a power of two."""
    most = max(1, min(CHUNK, runs // CHUNKS))
    return 1 << (most.bit_length() - 1)


def _table(table: Mapping[str, Any], key: str, path: Path) -> Mapping[str, Any]:
    content = table.get(key, {})
    if not isinstance(content, Mapping):
        raise CanrollError(f"{path}: {key} must be a table, write [{key}]")
    return content


def _whole(value: object, where: str, least: int, most: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise CanrollError(f"{where} must be a whole number, got {value!r}")
    if value < least:
        raise CanrollError(f"{where} must be at least {least}, got {value}")
    if value > most:
        raise CanrollError(f"{where} must be at most {most}, got {value}")
    return value


def _flat(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield name and distribution; "vehicle.tyre.radius" may be written as nested tables."""
    for key, value in table.items():
        name = prefix + key
        if isinstance(value, Mapping) and (
            key in GROUPS
            if not prefix
            else value and all(isinstance(part, Mapping) for part in value.values())
        ):
            yield from _flat(value, f"{name}.")
        else:
            yield name, value


def _choices(table: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return the choices of the run, each checked."""
    known = [name for name in CHOICES if name not in OWN]
    documents.refuse_unknown(table, known, f"key of {where}")
    for name, value in table.items():
        CHOICES[name].check_in_file(value, f"{where} {name}")
    return dict(table)


def _faults(table: Mapping[str, Any], where: str) -> Discrete:
    documents.refuse_unknown(table, ("of", "single", "double"), f"key of {where}")
    faults = table.get("of")
    if not isinstance(faults, list) or not faults or not all(isinstance(f, str) for f in faults):
        raise CanrollError(f"{where} of: {faults!r} must be a list of faults")
    if len(set(faults)) < len(faults):
        raise CanrollError(f"{where} of: names a fault twice")
    shares = {}
    for key in ("single", "double"):
        share = table.get(key, 0.0)
        if not is_number(share) or not 0 <= share <= 1:
            raise CanrollError(f"{where} {key}: {share!r} must be a probability, 0 to 1")
        shares[key] = float(share)
    if sum(shares.values()) > 1:
        raise CanrollError(f"{where}: single and double together must be at most 1")
    if shares["double"] and len(faults) < 2:
        raise CanrollError(f"{where} double: needs two faults in of")
    return fault_sets(faults, **shares)


def _correlations(entries: object, path: Path) -> Iterator[Correlation]:
    where = f"{path} [[correlation]]"
    if not isinstance(entries, list) or not all(isinstance(e, Mapping) for e in entries):
        raise CanrollError(f"{path}: correlation must be a list of tables, write [[correlation]]")
    for entry in entries:
        documents.refuse_unknown(entry, ("of", "rank"), f"key of {where}")
        of, rank = entry.get("of"), entry.get("rank")
        if not isinstance(of, list) or len(of) != 2 or not all(isinstance(n, str) for n in of):
            raise CanrollError(f"{where} of: {of!r} must be the names of two quantities")
        if not is_number(rank) or not -1 < rank < 1:
            raise CanrollError(f"{where} rank: {rank!r} must be above -1 and below 1")
        yield Correlation(of[0], of[1], float(rank))
