"""The report page of a campaign: spread of the figures, and their sensitivity."""

import numpy as np

from hil.report.figure import DASHED, Figure, Series, distribution
from hil.report.page import Cell, Page, Table, Verdict, render
from hil.report.run_page import parameters, provenance
from hil.report.tables import LABELS, number
from hil.studies.campaign import QUANTITIES, Campaign, Outcome, quantiles

HARDEST = 10
"""How many of the hardest draws the page lists."""
SHOWN = 2
"""How many of a draw's factors stand beside it."""


def quantile_table(campaign: Campaign) -> Table:
    """Return least, 5 %, 50 %, 95 % and largest of each figure, without and with control."""
    found = quantiles(campaign.outcomes)
    columns = list(found[QUANTITIES[0]]["passive"])
    rows: list[list[str | Cell]] = []
    for name in QUANTITIES:
        label, digits = LABELS[name]
        for side, word in (("passive", "without control"), ("controlled", "with control")):
            if name == "moment_rms_nm" and side == "passive":
                continue
            rows.append(
                [
                    f"{label}, {word}",
                    *(
                        number(found[name][side][c], digits, f"quantiles.{name}.{side}.{c}")
                        for c in columns
                    ),
                ]
            )
    return Table("Figures over all draws", ("", "least", "5 %", "50 %", "95 %", "most"), rows)


def hardest_table(campaign: Campaign) -> Table:
    """Return the draws with the least reduction, failures first."""
    rows = [_row(outcome) for outcome in campaign.hardest[:HARDEST]]
    head = (
        "draw",
        "verdict",
        "without control (deg)",
        "with (deg)",
        "",
        "bus",
        "fault",
        "furthest out",
    )
    note = "'canroll campaign … --only DRAW' drives one draw again and reports it as a run."
    return Table("Hardest draws", head, rows, note)


def _row(outcome: Outcome) -> list[str | Cell]:
    place = f"outcomes.{outcome.index}"
    furthest = sorted(outcome.factors, key=lambda name: -abs(outcome.factors[name] - 1.0))
    factors = ", ".join(f"{name} {outcome.factors[name]:.2f}" for name in furthest[:SHOWN])
    sides = {"passive": outcome.passive, "controlled": outcome.controlled}
    return [
        str(outcome.index),
        outcome.verdict,
        *(number(f["roll_max_deg"], 2, f"{place}.{s}.roll_max_deg") for s, f in sides.items()),
        f"{-100 * outcome.reduction:+.0f} %".replace("-", "−"),
        outcome.bus,
        outcome.fault,
        factors,
    ]


def campaign_page(campaign: Campaign) -> str:
    """Return the page of a campaign as one HTML document."""
    settings = campaign.nominal.settings
    scenario = settings.scenario.replace("_", " ")
    headline, _, text = campaign.verdict.partition(": ")
    return render(
        Page(
            title=f"{len(campaign.outcomes)} draws of a {scenario}",
            subtitle=f"{settings.vehicle.name} at {settings.speed * 3.6:.0f} km/h, "
            f"{settings.law_name} with {settings.actuator}",
            verdict=Verdict(not campaign.failed, headline, text),
            warnings=campaign.nominal.warnings,
            tables=[quantile_table(campaign), hardest_table(campaign)],
            figures=[*_distributions(campaign), *_dependence(campaign)],
            playback=None,
            parameters=[
                ("draws", f"{len(campaign.outcomes)}, seed {campaign.seed}"),
                *((f"spread: {name}", f"± {100 * s:g} %") for name, s in campaign.spread.items()),
                *((f"nominal: {name}", text) for name, text in parameters(campaign.nominal)),
            ],
            provenance=provenance(campaign.nominal),
            result=campaign.to_json(),
            groups={"spread": "Distributions", "over": "What it depends on"},
        )
    )


def _distributions(campaign: Campaign) -> list[Figure]:
    plots = []
    for name in QUANTITIES:
        curves = []
        for side, word, colour, dash in (
            ("passive", "without control", 0, DASHED),
            ("controlled", "with control", 1, 0),
        ):
            values = np.array([getattr(o, side)[name] for o in campaign.outcomes])
            if values.any():
                curves.append(distribution(word, values, colour=colour, dash=dash))
        label = LABELS[name][0]
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
    """Reduction of the largest roll angle over each drawn quantity."""
    reduction = 100 * np.array([outcome.reduction for outcome in campaign.outcomes])
    return [
        Figure(
            f"over-{name.replace('_', '-')}",
            _capital(name.replace("_", " ")),
            f"{name.replace('_', ' ')}, times nominal",
            "less roll (%)",
            [
                Series(
                    "draws",
                    np.array([outcome.factors[name] for outcome in campaign.outcomes]),
                    reduction,
                    1,
                    kind="points",
                )
            ],
            group="over",
            linked=False,
            zero=True,
        )
        for name in campaign.outcomes[0].factors
    ]


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
