"""The page of a campaign; its size does not depend on the number of draws."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from canroll.extensions.campaign.events import EVENTS
from canroll.extensions.campaign.plan import SIDES, Columns
from canroll.extensions.campaign.quantities import FAULTS
from canroll.extensions.campaign.sensitivity import influences, predictions
from canroll.extensions.campaign.study import Campaign, probabilities
from canroll.extensions.campaign.summary import QUANTITIES, count_of, order, plain, reduction
from canroll.report.figure import DASHED, Figure, Series
from canroll.report.page import Cell, Page, PageTable, PageVerdict, render
from canroll.report.run_page import parameters, provenance
from canroll.report.tables import number
from canroll.runs.metrics import BY_KEY

HARDEST = 10
"""How many of the hardest draws the page lists."""
POINTS = 1000
"""Draws, the first ones, that are shown as points."""
SHARES = np.linspace(0.0, 1.0, 201)
WORDS = {"passive": "without control", "controlled": "with control"}


def probability_table(campaign: Campaign) -> PageTable:
    """Return count and interval of each event."""
    rows: list[list[str | Cell]] = []
    estimates = probabilities(campaign)
    for name, event in EVENTS.items():
        one = estimates[name]
        place = f"probabilities.{name}"
        rows.append(
            [
                event.label,
                str(one["count"]),
                *(
                    Cell(f"{100 * one[key]:.3g} %", one[key], f"{place}.{key}")
                    for key in ("share", "low", "high")
                ),
            ]
        )
    notes = {
        "exact": "Intervals of 95 % by Clopper and Pearson, exact for independent draws.",
        "as if independent": "Intervals of 95 % as if the draws were independent; stratified "
        "draws are not, so that they are no exact ones.",
        "at any time": "Confidence sequence of 95 %: it covers at all numbers of draws at once, "
        "so that the campaign could stop at the asked width.",
    }
    head = ("", "draws", "probability", "at least", "at most")
    return PageTable("Probabilities", head, rows, notes[estimates["fails"]["interval"]])


def quantile_table(campaign: Campaign) -> PageTable:
    """Return least, 5 %, 50 %, 95 % and largest of each figure, without and with control."""
    quantiles = campaign.summary.quantiles()
    columns = list(quantiles[QUANTITIES[0]]["passive"])
    rows: list[list[str | Cell]] = []
    for name in QUANTITIES:
        label, digits = BY_KEY[name].title, BY_KEY[name].digits
        for side, word in WORDS.items():
            if name == "moment_rms_nm" and side == "passive":
                continue
            values = quantiles[name][side]
            place = f"quantiles.{name}.{side}"
            cells = [number(values[key], digits, f"{place}.{key}") for key in columns]
            rows.append([f"{label}, {word}", *cells])
    return PageTable("Figures over all draws", ("", "least", "5 %", "50 %", "95 %", "most"), rows)


def hardest_table(campaign: Campaign, command: str) -> PageTable:
    """Return the hardest draws."""
    worst, names = campaign.summary.worst, campaign.plan.space.names
    head = ("draw", "verdict", *(f"{word} (deg)" for word in WORDS.values()), "", "drawn")
    rows: list[list[str | Cell]] = []
    for row in range(min(HARDEST, count_of(worst))):
        draw = plain(worst, row)
        drawn = ", ".join(f"{name} {_short(draw[name])}" for name in names if draw[name] != "")
        rows.append(
            [
                str(draw["draw"]),
                draw["verdict"],
                *(
                    number(draw[f"{side}_roll_max_deg"], 2, f"worst.{row}.{side}_roll_max_deg")
                    for side in SIDES
                ),
                f"{-100 * reduction(worst)[row]:+.0f} %".replace("-", "−"),
                drawn,
            ]
        )
    note = f"{order(campaign.summary.worst_by).capitalize()}. Drive one again as a run: "
    return PageTable("Hardest draws", head, rows, f"{note}{command} --only DRAW")


def influence_table(campaign: Campaign) -> PageTable | None:
    """Return the drawn quantities, the most influential first; None if none is drawn."""
    ranked = influences(campaign.plan, campaign.summary)
    rows: list[list[str | Cell]] = [
        [
            each.name,
            _text(each.first_order),
            _text(each.rank),
            _text(each.rank_reduction),
            _text(each.separates),
        ]
        for each in ranked
    ]
    head = ("", "first-order index", "rank correlation", "with reduction", "separates failures")
    note = (
        "Of the largest roll angle with control, over the first "
        f"{count_of(campaign.summary.sample)} draws: share of its variance explained by one "
        "quantity alone, Spearman's correlation with it and with its reduction by control; the "
        "probability that the quantity separates a failing draw from a good one (0.5: no better "
        "than chance; blank: too few failures)."
    )
    return PageTable("What matters", head, rows, note) if rows else None


def margin_table(campaign: Campaign) -> PageTable | None:
    """Return the linear margins of failing and good draws; None with few failures."""
    rows: list[list[str | Cell]] = [
        [each.name, f"{each.failed:.2f}", f"{each.good:.2f}", _text(each.separates)]
        for each in predictions(campaign.plan, campaign.summary)
    ]
    head = ("median of", "failing draws", "good draws", "separates them")
    note = (
        "Margins of the loop linearised at each drawn vehicle, speed and bus, driving straight; "
        "a margin that separates with a probability near 0.5 does not predict the failures."
    )
    return PageTable("Linear margins of the same draws", head, rows, note) if rows else None


def _text(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}".replace("-", "−")


def _short(value: Any) -> str:  # noqa: ANN401
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def campaign_page(campaign: Campaign, command: str, data: Mapping[str, Any]) -> str:
    """Return the page of a campaign as one HTML document.

    Args:
        campaign: what was found.
        command: command line of the campaign.
        data: its JSON object.
    """
    settings, plan = campaign.nominal.settings, campaign.plan
    headline, _, text = campaign.verdict.partition(": ")
    tables = (
        probability_table(campaign),
        quantile_table(campaign),
        hardest_table(campaign, command),
        influence_table(campaign),
        margin_table(campaign),
    )
    drawn = plan.description["draw"]
    return render(
        Page(
            title=f"{campaign.summary.draws} draws of a {settings.scenario.replace('_', ' ')}",
            subtitle=f"{settings.vehicle_name} at {settings.speed * 3.6:.0f} km/h, "
            f"{settings.law_name} with {settings.actuator}",
            verdict=PageVerdict(not campaign.summary.fails, headline, text),
            warnings=campaign.nominal.warnings,
            tables=[table for table in tables if table is not None],
            figures=[*_distributions(campaign), *_dependence(campaign)],
            playback=None,
            parameters=[
                ("draws", f"{campaign.summary.draws}, {_sampling(campaign)}"),
                *((f"drawn: {name}", _written(name, how)) for name, how in drawn.items()),
                *(
                    (f"correlation: {pair.first}, {pair.second}", f"{pair.rank:g}")
                    for pair in plan.space.correlations
                ),
                *((f"nominal: {name}", text) for name, text in parameters(campaign.nominal)),
            ],
            provenance=[*provenance(campaign.nominal), ("plan", plan.digest)],
            result=data,
            groups={"spread": "Distributions", "over": "What it depends on"},
        )
    )


def _sampling(campaign: Campaign) -> str:
    sampling = campaign.plan.sampling
    return f"{sampling.method.replace('_', ' ')}, seed {sampling.seed}, chunks of {sampling.chunk}"


def _written(name: str, how: Mapping[str, Any]) -> str:
    if name == FAULTS:
        sets = zip(how["values"], how["weights"], strict=True)
        return ", ".join(f"{' + '.join(faults) or 'none'} {w:.3g}" for faults, w in sets)
    return ", ".join(f"{key} {_list(value)}" for key, value in how.items())


def _list(values: Sequence[Any]) -> str:
    return f"[{', '.join(map(_short, values))}]"


def _distributions(campaign: Campaign) -> list[Figure]:
    plots = []
    for name in QUANTITIES:
        curves = []
        for side, colour, dash in (("passive", 0, DASHED), ("controlled", 1, 0)):
            values = campaign.summary.sketches[name, side].quantiles(SHARES)
            if values.any():
                curves.append(Series(WORDS[side], values, 100 * SHARES, colour, dash, "step"))
        label = BY_KEY[name].title
        plots.append(
            Figure(
                f"spread-{name.replace('_', '-')}",
                _capital(label),
                label,
                "share of draws (%)",
                curves,
                group="spread",
                linked=False,
                zero=True,
            )
        )
    return plots


def _dependence(campaign: Campaign) -> list[Figure]:
    """Reduction of the largest roll angle over each drawn number, of the first draws."""
    rows: Columns = campaign.summary.sample
    less = 100 * reduction(rows)[:POINTS]
    return [
        Figure(
            f"over-{name.replace('_', '-').replace('.', '-')}",
            _capital(name.replace("_", " ")),
            name.replace("_", " ") + (", times nominal" if name.startswith("vehicle.") else ""),
            "less roll (%)",
            [Series("draws", rows[name][:POINTS], less, 1, kind="points")],
            group="over",
            linked=False,
            zero=True,
        )
        for name in campaign.plan.space.names
        if rows[name].dtype != object
    ]


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
