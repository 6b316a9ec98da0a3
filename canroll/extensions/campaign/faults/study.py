"""Every fault of a catalogue driven, and judged: detected, when, and with what harm.

Each is driven once with control and compared with the passive vehicle without faults; what is
detected and harmful is driven again without the reaction. Nothing is assumed of a fault: an entry
without any effect on the run, or that this bus or these actuators cannot have, gets no verdict and
says why.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from canroll.cases.execution import IN_TURN, Cases
from canroll.cases.identity import identity
from canroll.errors import CanrollError
from canroll.extensions.campaign.faults.catalogue import (
    CATALOGUE,
    DETECTED,
    DOUBLE,
    GROUPS,
    CatalogueEntry,
    entries,
)
from canroll.gain_gen.models.task import Task
from canroll.gain_gen.monitors.bank import Bank
from canroll.gain_gen.monitors.detectability import bank_of_calibration
from canroll.gain_gen.monitors.uncertainty import stated
from canroll.plant_sim.can_bus.network.own_frames import bus_map
from canroll.plant_sim.faults import parse
from canroll.reaction import reaction, switched_off
from canroll.reaction.reaction import Reaction
from canroll.reaction.visibility import Visibility, visibility
from canroll.runs.experiment import delay_of, drive, plan
from canroll.runs.metrics import peak
from canroll.runs.result import Run
from canroll.runs.trace import Trace
from canroll.setup.choices import PASSIVE
from canroll.setup.controller import Controller

NO_EFFECT = "it changes nothing in this run"
ALL, SINGLES = "all", "all single"


@dataclass(frozen=True, slots=True)
class JudgedFault:
    """An entry with what happened.

    Attributes:
        entry: the entry.
        reaction: reaction of the ECU; None where the fault could not be driven.
        roll_max_deg: largest roll angle with control.
        no_verdict: why there is no verdict, or "".
        visibility: how visible to the residuals what did harm undetected was; None where nothing
            did, or this bus and plant do not say.
        by_reaction: whether it was detected, and harmful only by what was done about it: without
            the reaction of :mod:`canroll.reaction.switched_off` the same fault does no harm.
    """

    entry: CatalogueEntry
    reaction: Reaction | None
    roll_max_deg: float | None
    no_verdict: str
    visibility: Visibility | None = None
    by_reaction: bool = False

    @property
    def detected(self) -> bool:
        """Whether the fault was detected."""
        return self.reaction is not None and self.reaction.detected_after is not None

    @property
    def harmful(self) -> bool:
        """Whether the run was harmful."""
        return self.reaction is not None and bool(self.reaction.harm)

    @property
    def in_time(self) -> bool:
        """Whether the detection came before the first harm, or there was none."""
        if self.reaction is None or self.reaction.detected_after is None:
            return False
        limit = self.reaction.harm_after
        return limit is None or self.reaction.detected_after <= limit

    @property
    def undetected_harm(self) -> bool:
        """Whether harm was done and nothing detected."""
        return self.harmful and not self.detected

    @property
    def failed(self) -> bool:
        """Whether harm was done undetected that nothing excuses, or by the reaction."""
        excused = self.visibility is not None and self.visibility.excused
        return self.by_reaction or (self.undetected_harm and not excused)

    @property
    def as_expected(self) -> bool | None:
        """Whether the reaction is the expected one; None without a verdict."""
        if self.no_verdict or self.reaction is None:
            return None
        if self.entry.expect == DETECTED:
            right = not self.entry.mode or self.entry.mode in {
                change.mode for change in self.reaction.modes
            }
            return self.detected and right and not self.harmful
        return not self.harmful

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            **asdict(self.entry),
            "detected": self.detected,
            "harmful": self.harmful,
            "undetected_harm": self.undetected_harm,
            "by_reaction": self.by_reaction,
            "as_expected": self.as_expected,
            "no_verdict": self.no_verdict,
            "roll_max_deg": self.roll_max_deg,
            "visibility": None if self.visibility is None else asdict(self.visibility),
            "reaction": None if self.reaction is None else self.reaction.to_json(),
        }


@dataclass(frozen=True, slots=True)
class Coverage:
    """Diagnostic coverage of a group of faults.

    Attributes:
        group: what fails.
        faults: number of faults.
        judged: those with a verdict.
        detected: those detected.
        harmful: those that did harm.
        in_time: those that did harm and were detected before.
        undetected_harm: those that did harm and were not detected.
        by_reaction: those that were harmful only by the reaction.
        coverage: share of the detected among those that were detected or did harm; None: none was.
        median_s: median time to the detection.
        most_s: longest time to the detection.
    """

    group: str
    faults: int
    judged: int
    detected: int
    harmful: int
    in_time: int
    undetected_harm: int
    by_reaction: int
    coverage: float | None
    median_s: float | None
    most_s: float | None


@dataclass(frozen=True, slots=True)
class FaultStudy:
    """All judged faults, with the run without any."""

    settings: Run
    reference: Reaction
    faults: tuple[JudgedFault, ...]

    @property
    def undetected(self) -> tuple[JudgedFault, ...]:
        """Those that did harm undetected."""
        return tuple(fault for fault in self.faults if fault.undetected_harm)

    @property
    def coverage(self) -> list[Coverage]:
        """Diagnostic coverage by group, of all single faults, and of all."""
        groups = [*GROUPS.values(), DOUBLE]
        shares = [
            _coverage(group, [f for f in self.faults if f.entry.group == group]) for group in groups
        ]
        singles = [fault for fault in self.faults if fault.entry.group != DOUBLE]
        shares.insert(-1, _coverage(SINGLES, singles))
        return [*(c for c in shares if c.faults), _coverage(ALL, self.faults)]

    @property
    def false_alarm(self) -> bool:
        """Whether the ECU found a fault in the run without any."""
        return bool(self.reference.codes)

    @property
    def verdict(self) -> str:
        """The verdict in one line."""
        every = self.coverage[-1]
        text = (
            f"{every.detected} of {every.judged} faults detected, {every.harmful} harmful, "
            f"{every.undetected_harm} harmful and undetected"
        )
        if every.by_reaction:
            text += f", {every.by_reaction} harmful by the reaction alone"
        if self.undetected:
            excused = sum(not fault.failed for fault in self.undetected)
            text += f" ({excused} of them too small to be found for certain)"
        rest = every.faults - every.judged
        text += f"; {rest} without verdict" if rest else ""
        if self.reference.harm:
            text += f"; without faults {' and '.join(self.reference.harm)}, judged beyond that"
        if self.false_alarm:
            names = ", ".join(code.name for code in self.reference.codes)
            return f"False alarm in the run without faults ({names}); {text}"
        return text

    @property
    def exit_code(self) -> int:
        """1 where harm is done unseen, unexcused, or by the reaction, or in a false alarm."""
        return int(any(fault.failed for fault in self.faults) or self.false_alarm)

    def to_json(self) -> dict[str, Any]:
        """Return the object printed by ``canroll faults --json``."""
        settings = self.settings
        return {
            "scenario": settings.scenario,
            **settings.vehicles,
            "law": settings.law,
            "actuator": settings.actuator,
            "bus": settings.bus,
            "seed": settings.seed,
            "verdict": self.verdict,
            "undetected_harm": [fault.entry.name for fault in self.undetected],
            "coverage": [asdict(coverage) for coverage in self.coverage],
            "without_faults": self.reference.to_json(),
            "faults": [fault.to_json() for fault in self.faults],
        }


def _coverage(group: str, faults: Sequence[JudgedFault]) -> Coverage:
    judged = [fault for fault in faults if not fault.no_verdict]
    times = [
        fault.reaction.detected_after
        for fault in judged
        if fault.reaction is not None and fault.reaction.detected_after is not None
    ]
    dangerous = [fault for fault in judged if fault.detected or fault.harmful]
    return Coverage(
        group=group,
        faults=len(faults),
        judged=len(judged),
        detected=len(times),
        harmful=sum(fault.harmful for fault in judged),
        in_time=sum(fault.harmful and fault.in_time for fault in judged),
        undetected_harm=sum(fault.undetected_harm for fault in judged),
        by_reaction=sum(fault.by_reaction for fault in judged),
        coverage=len(times) / len(dangerous) if dangerous else None,
        median_s=median(times) if times else None,
        most_s=max(times, default=None),
    )


@dataclass(frozen=True, slots=True)
class StudiedLoop:
    """What the faults act on, with its runs without any: without and with control."""

    settings: Run
    controller: Controller
    passive: Trace
    healthy: Trace
    bank: Bank | None


def residuals_of(settings: Run, controller: Controller) -> Bank | None:
    """Return the residuals of a controller; None where a run does not say all that they need."""
    if bus_map(settings.profile) is not None or settings.plant != "nonlinear":
        return None
    task = Task(
        controller.vehicle,
        delay_of(settings),
        tick=controller.tick,
        actuator=controller.actuator,
        observer=controller.observer,
    )
    box = stated(controller.tables.get("uncertainty", {}))
    bank = bank_of_calibration(controller.record, task, box)
    return bank if bank.residuals else None


def judge(loop: StudiedLoop, entry: CatalogueEntry) -> JudgedFault:
    """Drive one fault."""
    settings = replace(loop.settings, faults=(entry.faults,))
    try:
        trace = drive(settings, loop.controller, enabled=True)
    except CanrollError as error:
        return JudgedFault(entry, None, None, str(error))
    observed = reaction.observe(trace, loop.passive, parse(entry.faults), loop.healthy)
    visible, by_reaction = None, False
    if observed.harm and observed.detected_after is not None:
        alone = replace(settings, faults=(switched_off.unreported(entry.faults),))
        record = switched_off.unsupervised(loop.controller.record)
        left = drive(alone, replace(loop.controller, record=record), enabled=True)
        by_reaction = not reaction.observe(
            left, loop.passive, parse(entry.faults), loop.healthy
        ).harm
    if observed.undetected_harm and observed.start is not None and loop.bank is not None:
        visible = visibility(trace, loop.healthy, loop.bank, settings.vehicle, observed.start)
    return JudgedFault(
        entry,
        observed,
        float(np.degrees(peak(trace.signals["roll"]))),
        observed.no_verdict or (NO_EFFECT if _same(trace, loop.healthy) else ""),
        visible,
        by_reaction,
    )


def _same(one: Trace, other: Trace) -> bool:
    """Whether two runs had the same frames and the same motion."""
    return one.frames.tobytes() == other.frames.tobytes() and all(
        np.array_equal(values, other.signals[name]) for name, values in one.signals.items()
    )


def study(
    scenario: str = "double_lane_change",
    *,
    catalogue: Path = CATALOGUE,
    cases: Cases = IN_TURN,
    **choices: Any,  # noqa: ANN401
) -> FaultStudy:
    """Drive every fault of the catalogue.

    Args:
        scenario: name of the manoeuvre.
        catalogue: TOML file of the faults, by default the shipped one.
        cases: what drives the faults.
        choices: as in :class:`canroll.setup.choices.Choices`, except faults.

    Raises:
        CanrollError: an invalid name or number.
        VerdictError: the design fails its own checks.
    """
    if choices.get("law") == PASSIVE:
        raise CanrollError("--law passive has no control to evaluate: choose another law")
    settings, controller = plan(scenario, **choices)
    chosen = cases.picked(entries(settings, catalogue))
    passive = drive(settings, controller, enabled=False)
    healthy = drive(settings, controller, enabled=True)
    study = cases.of(identity(settings, controller) | {"faults": chosen})
    bank = residuals_of(settings, controller)
    loop = study.engine.common(StudiedLoop(settings, controller, passive, healthy, bank))
    faults = study.rows("faults", judge, [(loop, entry) for entry in chosen])
    return FaultStudy(settings, reaction.observe(healthy, passive, ()), tuple(faults))
