"""What the ECU noticed in a run, as a table for terminal and page."""

from hil.reaction.reaction import WRONG_MOMENT, WRONG_TIME
from hil.report.page import Cell, Table
from hil.report.tables import number
from hil.runs.result import Result

HARMFUL = (
    "Wrong side: moment of the actuators that pushes the body outwards in a curve. Harmful: more "
    f"than {WRONG_MOMENT:.0f} N·m of it for more than {1e3 * WRONG_TIME:.0f} ms, or roll angle or "
    "path error over 1.1 times those of the passive vehicle."
)


def reaction_table(result: Result) -> Table | None:
    """Return modes and fault codes with their times, and the moment on the wrong side."""
    reaction = result.reaction
    if reaction is None:
        return None
    rows: list[tuple[str | Cell, ...]] = [
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
    longest = number(reaction.wrong_side_s, 2, "reaction.wrong_side_s")
    rows += [
        ("wrong side, largest moment (N·m)", wrong, ""),
        (f"wrong side, longest time over {WRONG_MOMENT:.0f} N·m (s)", longest, ""),
    ]
    return Table("Modes and fault codes", ("", "from (s)", "to (s)"), rows, HARMFUL)
