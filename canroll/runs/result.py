"""Result of a run: traces, figures, settings, and the object that ``--json`` prints."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from canroll.codegen.generated.own_stage import OwnStage
from canroll.codegen.run.backends import default_backend
from canroll.codegen.run.bus_firmware import BusFirmware
from canroll.dbc.reader import file_names, paths_of
from canroll.errors import optional
from canroll.firmware.calibration import Calibration
from canroll.gain_gen.models.task import Delay
from canroll.plant_sim.can_bus import BusProfile, load_profile
from canroll.reaction.reaction import Reaction
from canroll.runs.conditions import fault_texts
from canroll.runs.limit_cycle import LimitCycle
from canroll.runs.metrics import BY_KEY, NUMBERS, Can, Metrics, Trigger
from canroll.runs.phase import Phase
from canroll.runs.standard import Standard, StandardOutcome
from canroll.runs.trace import Trace
from canroll.setup.bus_frames import firmware_of, secret_of
from canroll.setup.choice import as_text, one_or_several
from canroll.setup.choices import CHOICES, chosen
from canroll.vehicles import Vehicle

if TYPE_CHECKING:
    import pandas
    import xarray

SAVED = tuple(name for name, choice in CHOICES.items() if choice.saved)
"""The choices stored in results; all others are in their calibration."""
SHOWN = ("roll_max_deg", "nlt_front_max", "nlt_rear_max")
"""Metrics of a result's ``repr``."""


@dataclass(frozen=True, slots=True)
class Run:
    """A run as planned: what is driven, by which law, over which bus, with which faults.

    ``speed`` in m/s, ``tick`` and ``phase`` in s (phase None: that of clocks that start together);
    ``command``: the message that commands the actuators; ``options`` of the manoeuvre; ``faults``
    and ``conditions`` of sensors and actuators as :func:`canroll.runs.conditions.options` reads
    them; ``dbc`` (one file or several) and ``map``: the frames on the bus, None for those of the
    contract or the network's own; ``key``: the file of the key, None for the development key;
    ``stage``: a user's stage of the loop. ``vehicle`` is driven; ``plant_vehicle`` is its name or
    file if it is not the one the controller was designed for, else None; ``designed_for`` is the
    name of that one.
    """

    scenario: str
    vehicle: Vehicle
    law: str
    actuator: str
    command: str
    observer: str
    plant: str
    bus: str
    backend: str
    seed: int
    speed: float
    tick: float
    options: tuple[tuple[str, Any], ...] = ()
    faults: tuple[str, ...] = ()
    conditions: tuple[tuple[str, Any], ...] = ()
    phase: float | None = None
    dbc: str | tuple[str, ...] | None = None
    map: str | None = None
    plant_vehicle: str | None = None
    designed_for: str | None = None
    key: str | None = None
    stage: OwnStage | None = None

    @property
    def vehicle_name(self) -> str:
        """The vehicle that is driven, and the one designed for if it is another."""
        if self.designed_for in (None, self.vehicle.name):
            return self.vehicle.name
        return f"{self.vehicle.name} (designed for {self.designed_for})"

    @property
    def vehicles(self) -> dict[str, str | None]:
        """The vehicle designed for, and the driven one if it is another, as results name them."""
        return {
            "vehicle": self.designed_for or self.vehicle.name,
            "plant_vehicle": self.plant_vehicle,
        }

    @property
    def law_name(self) -> str:
        """The law, and your own stage if the controller has one."""
        return self.law if self.stage is None else f"{self.law} and {self.stage.name}"

    @property
    def title(self) -> str:
        """Manoeuvre, vehicle and law."""
        return f"{self.scenario}, {self.vehicle_name}, {self.law_name}"

    @property
    def bus_name(self) -> str:
        """The bus in a few words: its name, and the file of the user's frames, if any."""
        bus = Path(self.bus).stem if self.bus.endswith(".toml") else self.bus
        return bus if self.dbc is None else f"{bus}, frames of {file_names(paths_of(self.dbc))}"

    @property
    def profile(self) -> BusProfile:
        """The bus with its frames."""
        return load_profile(self.bus, self.dbc, self.map)

    @property
    def secret(self) -> bytes:
        """The key of authenticated frames."""
        return secret_of({"key": self.key})

    @property
    def firmware(self) -> BusFirmware:
        """The ECU's program for the frames of the bus, with the own stage."""
        return firmware_of(self.profile, self.stage)

    def choices(self) -> dict[str, Any]:
        """Return these settings by the keywords of a run, without those of the calibration."""
        own = {
            **self.vehicles,
            "speed_kmh": self.speed * 3.6,
            "tick_ms": self.tick * 1e3,
            "options": dict(self.options),
            "faults": list(self.faults),
            "conditions": dict(self.conditions),
            "dbc": list(self.dbc) if isinstance(self.dbc, tuple) else self.dbc,
        }
        return {name: own[name] if name in own else getattr(self, name) for name in SAVED}

    @classmethod
    def of(cls, choices: Mapping[str, Any], **others: Any) -> "Run":  # noqa: ANN401
        """Return the run of these choices; the ``others`` stand instead of theirs.

        Raises:
            CanrollError: an invalid fault.
        """
        given = {name: chosen(choices, name) for name in SAVED}
        speed_kmh, tick_ms = given.pop("speed_kmh"), given.pop("tick_ms")
        own = {
            "designed_for": given["vehicle"],
            "backend": given["backend"] or default_backend(),
            "speed": None if speed_kmh is None else speed_kmh / 3.6,
            "tick": 1e-3 * tick_ms,
            "options": tuple(sorted((given["options"] or {}).items())),
            "faults": fault_texts(choices),
            "conditions": tuple(sorted((given["conditions"] or {}).items())),
            "dbc": one_or_several(given["dbc"]),
            "map": as_text(given["map"]),
            "key": as_text(given["key"]),
        }
        return cls(**{**given, **own, **others})


@dataclass(frozen=True, slots=True, repr=False)
class Result:
    """One manoeuvre driven without and with control.

    Attributes:
        settings: settings of the run.
        record: the calibration the ECU ran with.
        tables: the calibration's other tables.
        delay: bounds of the sample-to-force delay on this bus, s.
        passive: trace without control.
        controlled: trace with control, None for the law "passive".
        passive_metrics: figures of the passive run.
        controlled_metrics: figures of the controlled run or None.
        without_roll: remaining load transfer if the body did not roll at all, by metric; None if
            unknown.
        can: bus figures, preferably of the controlled run.
        trigger: transmission figures, preferably of the controlled run.
        limit_cycle: limit cycle of the command, or None.
        standard: verdicts of the manoeuvre's standard on both runs.
        options: every option of the manoeuvre in effect, defaults too.
        replay: trace with control and the steering of the passive run; None if the driver steers
            the same with and without control, as it would equal the controlled run.
        replay_metrics: figures of the replay or None.
        warnings: one line each.
        files: paths of its files, by name.
        timing: figures of a run of two programs as printed by ``canroll hil --json``; else empty.
        phase: phase of the ticks, preferably of the controlled run.
        reaction: modes, fault codes, detection and harm of the controlled run, if any.
    """

    settings: Run
    record: Calibration
    tables: Mapping[str, Any]
    delay: Delay
    passive: Trace
    controlled: Trace | None
    passive_metrics: Metrics
    controlled_metrics: Metrics | None
    without_roll: Mapping[str, float | None]
    can: Can
    trigger: Trigger
    limit_cycle: LimitCycle | None
    standard: Standard
    options: Mapping[str, Any] = field(default_factory=dict)
    replay: Trace | None = None
    replay_metrics: Metrics | None = None
    warnings: tuple[str, ...] = ()
    files: Mapping[str, str] = field(default_factory=dict)
    timing: Mapping[str, Any] = field(default_factory=dict)
    phase: Phase | None = None
    reaction: Reaction | None = None

    def to_xarray(self) -> "xarray.Dataset":
        """Return the traces side by side, along "run": passive, then controlled, if any.

        Raises:
            MissingExtraError: xarray is not installed.
        """
        passive = self.passive.to_xarray()
        if self.controlled is None:
            return passive.expand_dims(run=["passive"])
        xr = optional("xarray", "to_xarray()", "notebook")
        both = [passive, self.controlled.to_xarray()]
        runs = xr.Variable("run", ["passive", "controlled"])
        dataset: xarray.Dataset = xr.concat(
            both, runs, join="outer", combine_attrs="drop_conflicts"
        )
        return dataset

    def to_pandas(self) -> "pandas.DataFrame":
        """Return the signals of both runs as columns (run, signal) over "time".

        Raises:
            MissingExtraError: pandas is not installed.
        """
        runs = {"passive": self.passive.to_pandas()}
        if self.controlled is not None:
            runs["controlled"] = self.controlled.to_pandas()
        pandas = optional("pandas", "to_pandas()", "notebook")
        return pandas.concat(runs, axis="columns", names=["run", "signal"])

    def __repr__(self) -> str:
        figures = []
        for metric in (BY_KEY[key] for key in SHOWN):
            runs = (self.passive_metrics, self.controlled_metrics)
            values = [getattr(metrics, metric.key) for metrics in runs if metrics is not None]
            texts = [f"{v:.3g}" for v in values if v is not None]
            if texts:
                figures.append(f"{metric.title} {' → '.join(texts)}")
        return f"<{self.settings.title}: {self.verdict}; {', '.join(figures)}>"

    def _repr_html_(self) -> str:
        """The verdict and the figures, for a notebook."""
        runs = {"passive": self.passive_metrics, "controlled": self.controlled_metrics}
        shown = {name: metrics for name, metrics in runs.items() if metrics is not None}
        head = "".join(f"<th>{name}</th>" for name in shown)
        rows = ""
        for metric in NUMBERS:
            values = [getattr(metrics, metric.key) for metrics in shown.values()]
            cells = "".join(f"<td>{'' if v is None else f'{v:.3g}'}</td>" for v in values)
            rows += f"<tr><th>{escape(metric.title)}</th>{cells}</tr>"
        return (
            f"<p><b>{escape(self.settings.title)}</b><br>{escape(self.verdict)}</p>"
            f"<table><tr><th></th>{head}</tr>{rows}</table>"
        )

    @property
    def not_valid(self) -> tuple[str, ...]:
        """Reasons why the run is not valid and has no verdict; empty if it is valid."""
        return tuple(self.timing.get("not_valid", ()))

    @property
    def outcome(self) -> StandardOutcome:
        """What control does, by the figures of both runs."""
        runs = self.passive_metrics, self.controlled_metrics
        return StandardOutcome(*runs, self.limit_cycle, self.standard)

    @property
    def reduction(self) -> float | None:
        """Reduction of the largest roll angle by control, as a fraction.

        None without control or without any roll.
        """
        return self.outcome.reduction

    @property
    def helps(self) -> bool | None:
        """Whether control prevents a rollover, or reduces both RMS and largest roll angle.

        False with a limit cycle or a rollover; None without control, without any roll, or if the
        run is not valid.
        """
        return None if self.not_valid else self.outcome.helps

    @property
    def harmful(self) -> bool:
        """Whether faults were driven with and did harm."""
        return bool(self.settings.faults and self.reaction and self.reaction.harm)

    @property
    def good(self) -> bool | None:
        """The colour of the verdict: good, bad (also if harmful or not valid), or neither."""
        return False if self.not_valid or self.harmful else self.outcome.good

    @property
    def verdict(self) -> str:
        """The verdict in one line, with detection and harm of its faults."""
        if self.not_valid:
            return f"Not valid: {'; '.join(self.not_valid)}"
        text = self.outcome.sentence
        if self.reaction is None or not self.reaction.text:
            return text
        if self.harmful:
            return f"Harmful: {self.reaction.text}. {text}"
        return f"{text}; {self.reaction.text}"

    @property
    def exit_code(self) -> int:
        """The exit code: 1 if the verdict is bad."""
        return 1 if self.good is False else 0

    def to_json(self) -> dict[str, Any]:
        """Return the run as plain data, as printed by ``canroll run --json``."""
        settings = self.settings
        return {
            "scenario": settings.scenario,
            **{
                name: round(value, 9) if isinstance(value, float) else value
                for name, value in settings.choices().items()
            },
            "options_in_effect": dict(self.options),
            "duration_s": self.passive.duration,
            "calibration_id": self.record.id,
            "failed": list(self.tables["design"].get("failed", ())),
            "passive": asdict(self.passive_metrics),
            "controlled": asdict(self.controlled_metrics) if self.controlled_metrics else None,
            "replay": asdict(self.replay_metrics) if self.replay_metrics else None,
            "standard": None if self.not_valid else self.standard.to_json(),
            "without_roll": dict(self.without_roll),
            "can": asdict(self.can),
            "trigger": asdict(self.trigger),
            "authentication": self._authentication_json(),
            "phase_ms": self._phase_json(),
            "delay_ms": {name: 1e3 * value for name, value in asdict(self.delay).items()},
            "limit_cycle": asdict(self.limit_cycle) if self.limit_cycle else None,
            "reaction": None if self.reaction is None else self.reaction.to_json(),
            "helps": self.helps,
            "good": self.good,
            "not_valid": list(self.not_valid),
            "verdict": self.verdict,
            "warnings": list(self.warnings),
            "files": dict(self.files),
            **({"timing": dict(self.timing)} if self.timing else {}),
        }

    @property
    def refused(self) -> tuple[int, int] | None:
        """Frames that the ECU and the actuators refused as not authentic, as in :class:`Trace`."""
        return (self.passive if self.controlled is None else self.controlled).refused

    def _authentication_json(self) -> dict[str, Any] | None:
        if self.refused is None:
            return None
        ecu, actuators = self.refused
        key = "development" if self.settings.key is None else "own"
        return {"key": key, "refused": {"ecu": ecu, "actuators": actuators}}

    def _phase_json(self) -> dict[str, float | None]:
        chosen, achieved = self.settings.phase, self.phase
        return {
            "chosen": None if chosen is None else round(1e3 * chosen, 9),
            **({} if achieved is None else {k: 1e3 * v for k, v in asdict(achieved).items()}),
        }
