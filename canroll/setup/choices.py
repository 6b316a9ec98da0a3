"""The choices of a run, in one table.

:class:`Choices` are the keywords of :func:`canroll.run`. From their annotations come the options of
every command, ``law=lqr,bus=500k`` of ``canroll compare``, what a calibration excludes,
the settings in JSON objects and saved runs, and the command line of the plant in real time.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, TypedDict, get_args, get_origin, get_type_hints

from canroll.errors import CanrollError, UnknownNameError
from canroll.setup.choice import Choice, StateSpace
from codegen.run import BACKENDS
from gain_gen.laws import LAWS, OBSERVERS
from plant_sim.bodies import BODIES
from plant_sim.buses import BUSES
from vehicles import ACTUATORS, Vehicle

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


class Choices(TypedDict, total=False):
    """Keywords of a run; the default applies where one is omitted or None."""

    vehicle: Annotated[
        Vehicle | Mapping[str, Any] | Path | str | None,
        Choice(
            option="--vehicle",
            help="preset or TOML file",
            of=WORLD,
            default="van_real",
            frozen_in_calibration=True,
        ),
    ]
    plant_vehicle: Annotated[
        Vehicle | Mapping[str, Any] | Path | str | None,
        Choice(
            option="--plant-vehicle",
            help="vehicle to drive, if other than the one the controller is designed for; preset "
            "or TOML file",
            of=RUN,
        ),
    ]
    law: Annotated[
        str | None,
        Choice(
            option="--law",
            help="control law",
            of=CONTROLLER,
            default="steering_lead",
            values=lambda: (*LAWS, PASSIVE),
            extensible=LAWS,
            frozen_in_calibration=True,
        ),
    ]
    calibration: Annotated[
        str | Path | None,
        Choice(
            option="--calibration",
            help="calibration file written by canroll design, instead of a law",
            of=CONTROLLER,
            saved=False,
        ),
    ]
    stage: Annotated[
        str | Path | None,
        Choice(
            option="--stage",
            help="Python file that adds your stage to the loop, in the integer subset",
            of=CONTROLLER,
            saved=False,
        ),
    ]
    actuator: Annotated[
        str | None,
        Choice(
            option="--actuator",
            help="actuators of the vehicle",
            of=WORLD,
            default="bars",
            values=lambda: ACTUATORS,
            frozen_in_calibration=True,
        ),
    ]
    observer: Annotated[
        str | None,
        Choice(
            option="--observer",
            excludes=WITHOUT_CONTROL,
            help="roll observer of the ECU",
            of=CONTROLLER,
            default="two_sensors",
            values=lambda: OBSERVERS,
            frozen_in_calibration=True,
        ),
    ]
    plant: Annotated[
        str | None,
        Choice(
            option="--plant",
            help="simulated vehicle model, or MODEL.fmu with its map (MODEL.toml, or "
            "MODEL.fmu#MAP.toml)",
            of=WORLD,
            default="nonlinear",
            values=lambda: BODIES,
            extensible=BODIES,
        ),
    ]
    bus: Annotated[
        str | None,
        Choice(
            option="--bus",
            help="bus profile, network (.toml, .dbc, .kcd, .arxml, .sym) or log (.blf, .asc …); "
            "with several buses or channels FILE#NAME; with the bit rate of a log LOG@RATE",
            of=WORLD,
            default="500k",
            values=lambda: BUSES,
            extensible=BUSES,
        ),
    ]
    dbc: Annotated[
        Path | Sequence[str | Path] | str | None,
        Choice(
            option="--dbc",
            help="DBC, KCD, ARXML or SYM with the frames that carry the signals; requires --map; "
            "may be repeated",
            of=WORLD,
            repeated=True,
        ),
    ]
    map: Annotated[
        Path | str | None,
        Choice(
            option="--map",
            help="TOML file that says which signal of --dbc is which field of the ECU",
            of=WORLD,
        ),
    ]
    key: Annotated[
        Path | str | None,
        Choice(
            option="--key",
            rare=True,
            help="file with the key of a bus with authenticated frames; by default the public "
            "development key",
            of=WORLD,
        ),
    ]
    backend: Annotated[
        str | None,
        Choice(
            option="--backend",
            rare=True,
            help="execution of the firmware; native if a C compiler is installed",
            of=RUN,
            values=lambda: BACKENDS,
        ),
    ]
    seed: Annotated[
        int | None,
        Choice(
            option="--seed",
            help="random seed of sensor noise, bias, phases and background traffic",
            of=WORLD,
            default=0,
            low=0,
            high=2**31 - 1,
        ),
    ]
    speed_kmh: Annotated[
        float | None,
        Choice(
            option="--speed",
            help="entry speed; by default that of the vehicle for the manoeuvre",
            of=WORLD,
            unit="km/h",
            low=TINY,
        ),
    ]
    tick_ms: Annotated[
        float | None,
        Choice(
            option="--tick",
            help="period of the ECU loop, in whole µs",
            of=CONTROLLER,
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
            option="--phase",
            rare=True,
            help="time from the earliest arrival of an Imu frame to a tick; by default drawn from "
            "the seed",
            of=RUN,
            unit="ms",
            saved=False,
        ),
    ]
    trigger: Annotated[
        str | None,
        Choice(
            option="--trigger",
            rare=True,
            help="event-triggered commands, or one every tick",
            of=CONTROLLER,
            default="event",
            values=lambda: TRIGGERS,
            frozen_in_calibration=True,
            saved=False,
        ),
    ]
    heartbeat_ms: Annotated[
        float | None,
        Choice(
            option="--heartbeat",
            rare=True,
            help="maximum time between commands",
            of=CONTROLLER,
            default=50.0,
            unit="ms",
            low=1,
            frozen_in_calibration=True,
            saved=False,
        ),
    ]
    gains: Annotated[
        str | None,
        Choice(
            option="--gains",
            excludes=WITHOUT_CONTROL,
            rare=True,
            help="computed gains, or those printed in the law's paper",
            of=CONTROLLER,
            default="computed",
            values=lambda: GAINS,
            frozen_in_calibration=True,
            saved=False,
        ),
    ]
    matrices: Annotated[
        StateSpace | Mapping[str, Any] | str | Path | None,
        Choice(
            option="--matrices",
            help="file with the gains of --law custom: .toml, .npz or .mat",
            of=CONTROLLER,
            frozen_in_calibration=True,
            saved=False,
        ),
    ]
    unverified: Annotated[
        bool | None,
        Choice(
            option="--unverified",
            help="use a design that fails a check, marked, instead of refusing it",
            of=CONTROLLER,
            default=False,
            saved=False,
        ),
    ]
    moment_share: Annotated[
        float | None,
        Choice(
            option="--moment-share",
            excludes=WITHOUT_CONTROL,
            rare=True,
            help="RMS moment over the RMS of the roll moment m h a_y; of steering_lead, by "
            "default 0.8",
            of=CONTROLLER,
            low=TINY,
            high=1.5,
            frozen_in_calibration=True,
            saved=False,
        ),
    ]
    feedforward: Annotated[
        bool | None,
        Choice(
            option="--no-feedforward",
            excludes=WITHOUT_CONTROL,
            help="without the disturbance feedforward",
            of=CONTROLLER,
            default=True,
            frozen_in_calibration=True,
            saved=False,
        ),
    ]
    identification: Annotated[
        bool | None,
        Choice(
            option="--identification",
            excludes=WITHOUT_CONTROL,
            rare=True,
            help="identify roll stiffness and damping at run time",
            of=CONTROLLER,
            default=False,
            frozen_in_calibration=True,
            saved=False,
        ),
    ]
    offset_learning: Annotated[
        bool | None,
        Choice(
            option="--learn-offsets",
            excludes=WITHOUT_CONTROL,
            rare=True,
            help="learn the offsets of the sensors while driving straight",
            of=CONTROLLER,
            default=False,
            frozen_in_calibration=True,
            saved=False,
        ),
    ]
    response_watch: Annotated[
        bool | None,
        Choice(
            option="--no-watch-response",
            excludes=WITHOUT_CONTROL,
            rare=True,
            help="without the monitors that need the suspension's stroke rates",
            of=CONTROLLER,
            default=True,
            frozen_in_calibration=True,
            saved=False,
        ),
    ]
    uncertainty: Annotated[
        Mapping[str, Any] | None,
        Choice(
            option="--uncertainty",
            rare=True,
            help="half-width of what is not known of car, sensors or road, such as mass=0.05, that "
            "the monitors allow for; may be repeated",
            of=CONTROLLER,
            frozen_in_calibration=True,
            saved=False,
        ),
    ]
    options: Annotated[
        Mapping[str, Any] | None,
        Choice(
            option="--set",
            help="option of the manoeuvre, such as friction=0.6; may be repeated",
            of=WORLD,
        ),
    ]
    faults: Annotated[
        str | Sequence[str] | None,
        Choice(
            option="--fault",
            help="what fails: a sensor's signal (Imu.RollRate=stuck@3:5) or message, an actuator "
            "(front_left=weak:0.3@2), a node, the bus or an attacker, from START to END (s), fully "
            "after RAMP; 'A + B': together; see docs/faults.md; may be repeated",
            of=WORLD,
        ),
    ]
    fault_file: Annotated[
        str | Path | None,
        Choice(
            option="--faults",
            help="TOML file of faults, one in each table [[fault]]",
            of=WORLD,
            saved=False,
        ),
    ]
    conditions: Annotated[
        Mapping[str, Any] | None,
        Choice(
            option="--condition",
            help="sensors: noise, bias (1: as in the vehicle file), noise_end (s), temperature "
            "(K above calibration), drift, filtered, delayed, synchronous (on, off), "
            "phases.MESSAGE (s), lsb.MESSAGE.SIGNAL (SI units); actuators: supply (V), "
            "oil_temperature (°C), estimate_error, estimate_lag (s); may be repeated",
            of=WORLD,
        ),
    ]
    duration: Annotated[
        float | None,
        Choice(
            option="--duration",
            help="end of the run",
            of=RUN,
            unit="s",
            low=TINY,
            saved=False,
        ),
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
