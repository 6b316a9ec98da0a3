"""The family of a fitted vehicle: also the cars that it may be, in every condition."""

from dataclasses import replace

from canroll.errors import CanrollError
from canroll.gain_gen.analysis.family import Family, FamilyMargins, family_of
from canroll.gain_gen.models.task import Task
from canroll.vehicles.draws.fitted_cars import draws


def with_draws(family: Family, task: Task) -> Family:
    """Return the family of a task with the draws of its vehicle's fit, each at all conditions.

    Without a fit it is the family itself.

    Raises:
        CanrollError: a draw has no linear car, though the fitted vehicle has one.
    """
    members = list(family.members)
    for number, car in enumerate(draws(task.vehicle), 1):
        drawn = family_of(replace(task, vehicle=car))
        if drawn.note != family.note:
            raise CanrollError(
                f"{car.name}: draw {number} of its [fit]: {drawn.note}: fit again with more "
                "numbers held, or a log that tells more"
            )
        members += [
            replace(member, condition=replace(member.condition, draw=number))
            for member in drawn.members
        ]
    return replace(family, members=tuple(members))


def margins_of_draws(margins: FamilyMargins) -> dict[str, float]:
    """Return the worst margins of all draws, and of the fitted vehicle; empty without a fit."""
    drawn = [row for row in margins.rows if row.condition.draw]
    if not drawn:
        return {}
    alone = [row for row in margins.rows if not row.condition.draw]
    result = {"draws": float(max(row.condition.draw for row in drawn))}
    for name, rows in (("draws", drawn), ("fitted", alone)):
        of = [row.margins for row in rows]
        result[f"{name}_gain_db"] = min(each.gain_db for each in of)
        result[f"{name}_phase_deg"] = min(each.phase_deg for each in of)
        result[f"{name}_peak_sensitivity"] = max(each.sensitivity for each in of)
    return result
