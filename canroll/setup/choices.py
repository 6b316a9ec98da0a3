"""The choices of a run, in one table.

:class:`Choices` are the keywords of :func:`canroll.run`. From their annotations come the options of
every command, ``law=lqr,bus=500k`` of ``canroll compare``, what a calibration excludes,
the settings in JSON objects and saved runs, and the command line of the plant in real time.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, TypedDict, get_args, get_origin, get_type_hints

from canroll.codegen.run import BACKENDS
from canroll.errors import CanrollError, UnknownNameError
from canroll.gain_gen.laws import LAWS, OBSERVERS
from canroll.plant_sim.bodies import BODIES
from canroll.plant_sim.buses import BUSES
from canroll.setup.choice import Choice, StateSpace
from canroll.vehicles import ACTUATORS, Vehicle

PROJECT_FILE = "CANROLL_PROJECT_FILE"
"""Environment variable with the path of the file read as ``canroll.toml``; empty: none is read."""
PASSIVE = "passive"
"""The law of no control."""
TRIGGERS = ("event", "every")
GAINS = ("computed", "theorem", "as_printed")
OF_ONE_MANOEUVRE = ("calibration", "speed_kmh", "options", "seed", "phase_ms", "duration")
"""Choices of a run that a study over manoeuvres and vehicles has no use for."""
WORLD, CONTROLLER, RUN = "world", "controller", "run"


WITHOUT_CONTROL = {f"law={PASSIVE}": "--law passive has no control"}
TINY = 1e-9
"""Smallest accepted value of quantities that must be positive."""

Car = Vehicle | Mapping[str, Any] | Path | str | None
calibrated = partial(Choice, of=CONTROLLER, frozen_in_calibration=True, saved=False)
"""A choice that stands in the calibration alone."""


class Choices(TypedDict, total=False):
    """Keywords of a run; the default applies where one is omitted or None."""

    vehicle: Annotated[
        Car,
        Choice(
            "--vehicle",
            "preset or TOML file",
            WORLD,
            default="van_real",
            frozen_in_calibration=True,
        ),
    ]
    plant_vehicle: Annotated[
        Car,
        Choice(
            "--plant-vehicle",
            "vehicle to drive, if other than the one the controller is designed for; preset or "
            "TOML file",
            RUN,
        ),
    ]
    law: Annotated[
        str | None,
        Choice(
            "--law",
            "control law",
            CONTROLLER,
            default="steering_lead",
            values=lambda: (*LAWS, PASSIVE),
            extensible=LAWS,
            frozen_in_calibration=True,
        ),
    ]
    calibration: Annotated[
        str | Path | None,
        Choice(
            "--calibration",
            "calibration file written by canroll design, instead of a law",
            CONTROLLER,
            saved=False,
        ),
    ]
    stage: Annotated[
        str | Path | None,
        Choice(
            "--stage",
            "Python file that adds your stage to the loop, in the integer subset",
            CONTROLLER,
            saved=False,
        ),
    ]
    actuator: Annotated[
        str | None,
        Choice(
            "--actuator",
            "actuators of the vehicle",
            WORLD,
            default="bars",
            values=lambda: ACTUATORS,
            frozen_in_calibration=True,
        ),
    ]
    observer: Annotated[
        str | None,
        Choice(
            "--observer",
            "roll observer of the ECU",
            CONTROLLER,
            excludes=WITHOUT_CONTROL,
            default="two_sensors",
            values=lambda: OBSERVERS,
            frozen_in_calibration=True,
        ),
    ]
    plant: Annotated[
        str | None,
        Choice(
            "--plant",
            "simulated vehicle model, or MODEL.fmu with its map (MODEL.toml, or "
            "MODEL.fmu#MAP.toml)",
            WORLD,
            default="nonlinear",
            values=lambda: BODIES,
            extensible=BODIES,
        ),
    ]
    bus: Annotated[
        str | None,
        Choice(
            "--bus",
            "bus profile, network (.toml, .dbc, .kcd, .arxml, .sym) or log (.blf, .asc …); with "
            "several buses or channels FILE#NAME; with the bit rate of a log LOG@RATE",
            WORLD,
            default="500k",
            values=lambda: BUSES,
            extensible=BUSES,
        ),
    ]
    dbc: Annotated[
        Path | Sequence[str | Path] | str | None,
        Choice(
            "--dbc",
            "DBC, KCD, ARXML or SYM with the frames that carry the signals; requires --map; may "
            "be repeated",
            WORLD,
            repeated=True,
        ),
    ]
    map: Annotated[
        Path | str | None,
        Choice(
            "--map", "TOML file that says which signal of --dbc is which field of the ECU", WORLD
        ),
    ]
    key: Annotated[
        Path | str | None,
        Choice(
            "--key",
            "file with the key of a bus with authenticated frames; by default the public "
            "development key",
            WORLD,
            rare=True,
        ),
    ]
    backend: Annotated[
        str | None,
        Choice(
            "--backend",
            "execution of the firmware; native if a C compiler is installed",
            RUN,
            rare=True,
            values=lambda: BACKENDS,
        ),
    ]
    seed: Annotated[
        int | None,
        Choice(
            "--seed",
            "random seed of sensor noise, bias, phases and background traffic",
            WORLD,
            default=0,
            low=0,
            high=2**31 - 1,
        ),
    ]
    speed_kmh: Annotated[
        float | None,
        Choice(
            "--speed",
            "entry speed; by default that of the vehicle for the manoeuvre",
            WORLD,
            unit="km/h",
            low=TINY,
        ),
    ]
    tick_ms: Annotated[
        float | None,
        Choice(
            "--tick",
            "period of the ECU loop, in whole µs",
            CONTROLLER,
            default=10.0,
            unit="ms",
            low=1,
            high=20,
            frozen_in_calibration=True,
        ),
    ]
    phase_ms: Annotated[
        float | None,
        Choice(
            "--phase",
            "time from the earliest arrival of an Imu frame to a tick; by default drawn from the "
            "seed",
            RUN,
            rare=True,
            unit="ms",
            saved=False,
        ),
    ]
    trigger: Annotated[
        str | None,
        calibrated(
            "--trigger",
            "event-triggered commands, or one every tick",
            rare=True,
            default="event",
            values=lambda: TRIGGERS,
        ),
    ]
    heartbeat_ms: Annotated[
        float | None,
        calibrated(
            "--heartbeat",
            "maximum time between commands",
            rare=True,
            default=50.0,
            unit="ms",
            low=1,
        ),
    ]
    gains: Annotated[
        str | None,
        calibrated(
            "--gains",
            "computed gains, or those printed in the law's paper",
            excludes=WITHOUT_CONTROL,
            rare=True,
            default="computed",
            values=lambda: GAINS,
        ),
    ]
    matrices: Annotated[
        StateSpace | Mapping[str, Any] | str | Path | None,
        calibrated("--matrices", "file with the gains of --law custom: .toml, .npz or .mat"),
    ]
    unverified: Annotated[
        bool | None,
        Choice(
            "--unverified",
            "use a design that fails a check, marked, instead of refusing it",
            CONTROLLER,
            default=False,
            saved=False,
        ),
    ]
    moment_share: Annotated[
        float | None,
        calibrated(
            "--moment-share",
            "RMS moment over the RMS of the roll moment m h a_y; of steering_lead, by default 0.8",
            excludes=WITHOUT_CONTROL,
            rare=True,
            low=TINY,
            high=1.5,
        ),
    ]
    feedforward: Annotated[
        bool | None,
        calibrated(
            "--no-feedforward",
            "without the disturbance feedforward",
            excludes=WITHOUT_CONTROL,
            default=True,
        ),
    ]
    identification: Annotated[
        bool | None,
        calibrated(
            "--identification",
            "identify roll stiffness and damping at run time",
            excludes=WITHOUT_CONTROL,
            rare=True,
            default=False,
        ),
    ]
    offset_learning: Annotated[
        bool | None,
        calibrated(
            "--learn-offsets",
            "learn the offsets of the sensors while driving straight",
            excludes=WITHOUT_CONTROL,
            rare=True,
            default=False,
        ),
    ]
    response_watch: Annotated[
        bool | None,
        calibrated(
            "--no-watch-response",
            "without the monitors that need the suspension's stroke rates",
            excludes=WITHOUT_CONTROL,
            rare=True,
            default=True,
        ),
    ]
    uncertainty: Annotated[
        Mapping[str, Any] | None,
        calibrated(
            "--uncertainty",
            "half-width of what is not known of car, sensors or road, such as mass=0.05, that the"
            " monitors allow for; may be repeated",
            rare=True,
        ),
    ]
    options: Annotated[
        Mapping[str, Any] | None,
        Choice("--set", "option of the manoeuvre, such as friction=0.6; may be repeated", WORLD),
    ]
    faults: Annotated[
        str | Sequence[str] | None,
        Choice(
            "--fault",
            "what fails: a sensor's signal (Imu.RollRate=stuck@3:5) or message, an actuator "
            "(front_left=weak:0.3@2), a node, the bus or an attacker, from START to END (s), "
            "fully after RAMP; 'A + B': together; see docs/campaign.md; may be repeated",
            WORLD,
        ),
    ]
    fault_file: Annotated[
        str | Path | None,
        Choice("--faults", "TOML file of faults, one in each table [[fault]]", WORLD, saved=False),
    ]
    conditions: Annotated[
        Mapping[str, Any] | None,
        Choice(
            "--condition",
            "sensors: noise, bias (1: as in the vehicle file), noise_end (s), temperature (K "
            "above calibration), drift, filtered, delayed, synchronous (on, off), phases.MESSAGE "
            "(s), lsb.MESSAGE.SIGNAL (SI units); actuators: supply (V), oil_temperature (°C), "
            "estimate_error, estimate_lag (s); may be repeated",
            WORLD,
        ),
    ]
    duration: Annotated[
        float | None, Choice("--duration", "end of the run", RUN, unit="s", low=TINY, saved=False)
    ]


def _kind(hint: Any) -> type:  # noqa: ANN401
    """Return the type of a value from its keyword's annotation."""
    given = [part for part in get_args(get_args(hint)[0]) if part is not NoneType]
    kind = given[-1]
    origin: type = get_origin(kind) or kind
    return origin


CHOICES: dict[str, Choice] = {
    name: replace(hint.__metadata__[0], name=name, kind=_kind(hint), hint=get_args(hint)[0])
    for name, hint in get_type_hints(Choices, include_extras=True).items()
}
"""Every choice by its keyword, in the order in which results list them."""


def check(choices: Mapping[str, Any]) -> None:
    """Reject invalid choices before any slow import.

    Raises:
        UnknownNameError: an unknown choice or name.
        CanrollError: a number out of range, or a choice that the calibration fixes.
    """
    for name, value in choices.items():
        if name not in CHOICES:
            meant = [choice.name for choice in CHOICES.values() if choice.word == name]
            raise UnknownNameError("choice of a run", name, CHOICES, near=meant)
        if CHOICES[name].repeated and value is not None and not value:
            raise CanrollError(f"{CHOICES[name].option} must not be empty")
        if value is not None:
            CHOICES[name].check(value)
    if (choices.get("dbc") is None) != (choices.get("map") is None):
        raise CanrollError("--dbc and --map require each other")
    if choices.get("calibration") is not None:
        for name in without_frozen(choices, frozen=True):
            if choices[name] not in (None, PASSIVE):
                choice = CHOICES[name]
                raise CanrollError(f"--calibration fixes the {choice.word}: omit {choice.option}")


def without_frozen(choices: Mapping[str, Any], *, frozen: bool = False) -> dict[str, Any]:
    """Return the choices not fixed by a calibration; with ``frozen`` those that are."""
    return {
        name: value
        for name, value in choices.items()
        if CHOICES[name].frozen_in_calibration == frozen
    }


def chosen(choices: Mapping[str, Any], name: str) -> Any:  # noqa: ANN401
    """Return the chosen value, or the default."""
    value = choices.get(name)
    return CHOICES[name].default if value is None else value
