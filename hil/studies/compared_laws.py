"""The laws that are compared at equal effort, and the one that sets it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Entry:
    """One law of the comparison.

    Attributes:
        name: as the table calls it.
        sensors: "S1": the paper's, roll rate alone; "S2": all; "": no sensors at all.
        keywords: what :func:`hil.runs.experiment.plan` is called with.
        scaled: to the common budget; a paper's law as printed is not.
        stiffer_bar: factor on the plant's roll stiffness instead of a law, or zero.
    """

    name: str
    sensors: str
    keywords: Mapping[str, Any]
    scaled: bool = True
    stiffer_bar: float = 0.0


ENTRIES = (
    Entry("passive", "", {"law": "passive"}, scaled=False),
    Entry("stiffer bar", "", {"law": "passive"}, scaled=False, stiffer_bar=1.3),
    Entry("hinf_delay", "S1", {"law": "hinf_delay"}),
    Entry("hinf_nodelay", "S1", {"law": "hinf_nodelay"}),
    Entry("hinf_event", "S1", {"law": "hinf_event"}),
    Entry("ay_feedforward", "S2", {"law": "ay_feedforward"}),
    Entry("rate_feedforward", "S2", {"law": "rate_feedforward"}),
    Entry("lqr, feedback only", "S2", {"law": "lqr", "feedforward": False}),
    Entry("hinf, feedback only", "S2", {"law": "hinf", "feedforward": False}),
    Entry("smc, feedback only", "S2", {"law": "smc", "feedforward": False}),
    Entry("lqr", "S2", {"law": "lqr"}),
    Entry("hinf", "S2", {"law": "hinf"}),
    Entry("smc", "S2", {"law": "smc"}),
    Entry("lqg_delay", "S2", {"law": "lqg_delay"}),
)
PRINTED = (
    Entry(
        "hinf_delay as printed", "S1", {"law": "hinf_delay", "gains": "as_printed"}, scaled=False
    ),
    Entry(
        "hinf_event as printed", "S1", {"law": "hinf_event", "gains": "as_printed"}, scaled=False
    ),
)
"""Laws whose printed gains are for one vehicle: van_2021."""
REFERENCE = "hinf_delay"
"""The paper's structure, tuned on the plant at hand: its effort is the budget of all."""
