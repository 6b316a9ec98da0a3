"""The figures of a run as rows of tables, for terminal and page alike."""

import numpy as np

from canroll.reaction.harm import HARMFUL
from canroll.reaction.reaction import WRONG_MOMENT, WRONG_TIME
from canroll.report.page import Cell, PageTable
from canroll.runs.metrics import NUMBERS
from canroll.runs.result import Result
from canroll.runs.standard import limit, measured

Row = tuple[str | Cell, ...]
NOTHING = Cell("")
RUN_NAMES = {"passive": "without control", "controlled": "with control"}

WRONG_SIDE = (
    "Wrong side: moment of the actuators that pushes the body outwards in a curve. Harmful: more "
    f"than {WRONG_MOMENT:.0f} N·m of it for more than {1e3 * WRONG_TIME:.0f} ms, or roll angle or "
    f"path error over {HARMFUL:g} times those of the passive vehicle."
)


def number(value: float | None, digits: int, key: str) -> Cell:
    """Return a cell for the number at ``key`` of the JSON object, empty for None."""
    if value is None:
        return NOTHING
    return Cell(f"{value:.{digits}f}".replace("-", "−"), value, key)


def change(after: float | None, before: float | None, digits: int) -> Cell:
    """Return the relative change in percent, or an empty cell if ``before`` is shown as 0."""
    if after is None or before is None or round(before, digits) == 0:
        return NOTHING
    percent = round(100 * (after / before - 1))
    return Cell(f"{percent:+d} %".replace("-", "−") if percent else "0 %")


def metric_rows(result: Result) -> list[Row]:
    """Return a row per metric: without control, with control, change, replay, without any roll.

    Without a replay its column is omitted, without a path the path errors.
    """
    rows: list[Row] = []
    for metric in NUMBERS:
        name, digits = metric.key, metric.digits
        before = getattr(result.passive_metrics, name)
        if name.startswith("path_error") and before == 0:
            continue
        cells = [number(before, digits, f"passive.{name}")]
        if result.controlled_metrics is None:
            cells += [NOTHING, NOTHING]
        else:
            after = getattr(result.controlled_metrics, name)
            cells += [number(after, digits, f"controlled.{name}"), change(after, before, digits)]
        if result.replay_metrics is not None:
            cells.append(number(getattr(result.replay_metrics, name), digits, f"replay.{name}"))
        least = result.without_roll.get(name)
        cells.append(number(least, digits, f"without_roll.{name}"))
        rows.append((metric.title, *cells))
    return rows


def metric_head(result: Result, passive: str, controlled: str) -> tuple[str, ...]:
    """Return the table head of :func:`metric_rows`, with names of the first two columns."""
    replayed = () if result.replay is None else ("replay",)
    return ("", passive, controlled, "change", *replayed, "no roll at all")


def authentication_note(result: Result) -> str | None:
    """Return the key and the frames refused, if the frames of the bus are authenticated."""
    if result.refused is None:
        return None
    ecu, actuators = result.refused
    key = "the public development key" if result.settings.key is None else "the key of --key"
    return (
        f"frames authenticated with {key}; refused: {ecu} by the ECU, {actuators} by the actuators"
    )


def replay_note(result: Result) -> str:
    """Return a note on what the replay is, or why there is none."""
    if result.controlled is None:
        return ""
    if result.replay is not None:
        return (
            "Replay: with control and the steering of the run without control, open loop, "
            "chassis control off."
        )
    first, second = result.passive.signals["steer"], result.controlled.signals["steer"]
    if not np.array_equal(first, second):
        return ""
    return "Control does not change the steering: no replay, as it would equal the controlled run."


def standard_rows(result: Result) -> list[Row]:
    """Return a row per criterion and run: run, criterion, clause, measured, limit, verdict."""
    return [
        (
            RUN_NAMES[run],
            verdict.criterion,
            verdict.clause,
            measured(verdict),
            limit(verdict),
            "met" if verdict.passed else "not met",
        )
        for run, judged in result.standard.runs()
        for verdict in judged.criteria
    ]


def can_rows(result: Result) -> list[Row]:
    """Return a row per message with least, mean and largest response time, and the age."""
    spreads = {
        f"{name}, response (ms)": (f"can.response_ms.{name}", spread)
        for name, spread in result.can.response_ms.items()
    }
    if result.can.age_ms is not None:
        spreads["sample to force, age (ms)"] = ("can.age_ms", result.can.age_ms)
    return [
        (
            label,
            *(
                number(getattr(spread, which), 2, f"{key}.{which}")
                for which in ("min", "mean", "max")
            ),
        )
        for label, (key, spread) in spreads.items()
    ]


def reaction_tables(result: Result) -> list[PageTable]:
    """Return modes and fault codes with their times, and the moment on the wrong side; or none."""
    reaction = result.reaction
    if reaction is None:
        return []
    rows: list[Row] = [
        (f"mode {change.mode}", number(change.t, 2, f"reaction.modes.{i}.t"), "")
        for i, change in enumerate(reaction.modes)
    ]
    rows += [
        (
            f"fault code {seen.code}: {seen.name}",
            number(seen.first, 2, f"reaction.codes.{i}.first"),
            number(seen.last, 2, f"reaction.codes.{i}.last"),
        )
        for i, seen in enumerate(reaction.codes)
    ]
    wrong = number(reaction.wrong_side_max_nm, 0, "reaction.wrong_side_max_nm")
    longest = number(reaction.wrong_side_s, 3, "reaction.wrong_side_s")
    head = ("", "largest (N·m)", f"longest over {WRONG_MOMENT:.0f} N·m (s)")
    return [
        PageTable("Modes and fault codes", ("", "from (s)", "to (s)"), rows),
        PageTable(
            "Moment on the wrong side",
            head,
            [("moment on the wrong side", wrong, longest)],
            WRONG_SIDE,
        ),
    ]
