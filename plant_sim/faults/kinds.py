"""What can fail, and how: the one table of the fault language.

Parser, files, refusals, help and docs/campaign.md are made from it.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

from canroll.plant_sim.buses.topology import NODES
from canroll.plant_sim.nodes import actuators, sensors

SIGNAL, MESSAGE, ACTUATOR, NODE, BUS, ATTACKER = (
    *("signal", "message", "actuator", "node", "bus", "attacker"),
)
NODE_PREFIX, ATTACKER_PREFIX = "node.", "attacker."
ECU_NODE, ACTUATOR_NODE = NODES[0], "Actuator"

SIGNALS = sensors.SIGNALS
SENSOR_MESSAGES = sensors.NODES
COMMANDS = tuple(
    dict.fromkeys(name for taken in actuators.COMMANDS.values() for name, _, _ in taken)
)
MESSAGES = (*SENSOR_MESSAGES, *COMMANDS)
COMMAND_SIGNALS = tuple(
    f"{name}.{signal}" for name in COMMANDS for signal in actuators.command_signals(name)
)


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultKind:
    """One way to fail.

    Attributes:
        name: its name.
        at: what can fail so: "signal", "message", "actuator", "node", "bus" or "attacker".
        help: what happens.
        value: what its value is, with the unit; empty if it has none.
        default: the value if none is given; None: one must be given.
        low: least value.
        high: largest value.
        ramps: whether it can come on gradually.
        repeats: whether it can be intermittent.
        start: whether it has a beginning; else it acts from the start of the run.
        end: whether it has an end; else its value says when.
        not_at: places of ``at`` that cannot fail so.
        sensors_only: at a message: only at those of sensors and actuators, not at commands.
    """

    name: str
    at: str
    help: str
    value: str = ""
    default: float | None = None
    low: float = -math.inf
    high: float = math.inf
    ramps: bool = False
    repeats: bool = True
    sensors_only: bool = False
    start: bool = True
    end: bool = True
    not_at: tuple[str, ...] = ()


_of_message = partial(FaultKind, at=MESSAGE, sensors_only=True)
_of_actuator = partial(FaultKind, at=ACTUATOR, ramps=True)
_lasting = partial(FaultKind, repeats=False)
_of_node = partial(_lasting, at=NODE)
_share = partial(FaultKind, value="fraction", low=0.0, high=1.0, ramps=True)
_flood = partial(_lasting, value="fraction", default=0.9, low=0.01, high=1.0)

KINDS: tuple[FaultKind, ...] = (
    FaultKind(name="stuck", at=SIGNAL, help="holds the last value, counters go on"),
    FaultKind(name="offset", at=SIGNAL, help="adds VALUE", value="SI unit", ramps=True),
    FaultKind(name="drift", at=SIGNAL, help="drifts away by VALUE each second", value="SI unit/s"),
    FaultKind(name="scale", at=SIGNAL, help="multiplies by VALUE", value="factor", ramps=True),
    FaultKind(name="reversed", at=SIGNAL, help="has the opposite sign", ramps=True),
    FaultKind(
        name="burst",
        at=SIGNAL,
        help="white noise of standard deviation VALUE",
        value="SI unit",
        low=0.0,
        ramps=True,
    ),
    FaultKind(
        name="spike",
        at=SIGNAL,
        help="adds VALUE to one sample, every 0.1 s or EVERY",
        value="SI unit",
        ramps=True,
    ),
    FaultKind(name="delay", at=SIGNAL, help="is late by VALUE", value="s", low=0.0, high=2.5),
    FaultKind(name="invalid", at=SIGNAL, help="sends the code for error"),
    FaultKind(name="dropout", at=SIGNAL, help="keeps its message off the bus"),
    _of_message(name="dropout", help="is not sent"),
    _of_message(
        name="frozen", help="repeats the last sample and its sample counter, protection goes on"
    ),
    _of_message(name="frozen_counter", help="repeats its counter of the protection"),
    FaultKind(name="stuck", at=ACTUATOR, help="holds its force and reports it"),
    _of_actuator(name="floating", help="delivers nothing and reports it"),
    _of_actuator(name="dead", help="delivers nothing, status OK"),
    _share(
        name="weak",
        at=ACTUATOR,
        help="delivers the fraction VALUE of its command, status limited",
        default=0.5,
    ),
    _of_actuator(
        name="slow", help="has VALUE times its lag, status OK", value="factor", low=1.0, high=1000.0
    ),
    _of_actuator(name="reversed", help="delivers the opposite, status OK"),
    _share(
        name="runaway",
        at=ACTUATOR,
        help="adds the fraction VALUE of its limit to its command, status OK",
        low=-1.0,
    ),
    _share(name="derating", at=ACTUATOR, help="is limited to the fraction VALUE of its limit"),
    FaultKind(
        name="lying",
        at=ACTUATOR,
        help="reports OK and the commanded moment, whatever else is wrong",
    ),
    _of_node(
        name="down",
        help="loses power: sends and receives nothing, then restarts; without power the "
        "actuators float",
    ),
    _of_node(
        name="reset",
        help="is down for VALUE, then restarts",
        value="s",
        default=0.1,
        low=0.001,
        high=1e6,
        end=False,
    ),
    _of_node(
        name="late",
        help="has no power before VALUE",
        value="s",
        low=0.001,
        high=1e6,
        start=False,
        end=False,
    ),
    _of_node(name="silent", help="hears, but sends nothing"),
    _of_node(
        name="bus_off",
        help="every frame that it sends is disturbed, until its controller leaves the bus",
    ),
    _flood(
        name="babbling",
        at=NODE,
        help="fills the share VALUE of its bus with frames of the highest priority",
    ),
    FaultKind(
        name="clock_drift",
        at=NODE,
        help="its cycle times are longer by the fraction VALUE",
        value="fraction",
        low=-0.5,
        high=1.0,
        ramps=True,
        not_at=(f"{NODE_PREFIX}{ECU_NODE}",),
    ),
    *(
        _share(name=name, at=at, help=text)
        for at in (MESSAGE, BUS)
        for name, text in (
            ("loss", "the receiver loses this fraction of the frames"),
            ("corruption", "one bit is wrong in this fraction of the frames, as received"),
            ("duplicate", "this fraction of the frames is sent twice"),
            ("reorder", "this fraction of the frames is overtaken by the next"),
        )
    ),
    *(
        _share(name="delay", at=at, help="frames are handed over late by VALUE", value="s")
        for at in (MESSAGE, BUS)
    ),
    _lasting(
        name="error_rate",
        at=BUS,
        help="every bit is disturbed with this probability",
        value="per bit",
        low=0.0,
        high=0.1,
    ),
    _flood(
        name="flood",
        at=BUS,
        help="fills the share VALUE of every bus with frames of the highest priority",
    ),
    _lasting(name="partition", at=BUS, help="its gateways forward nothing"),
    FaultKind(
        name="spoof",
        at=ATTACKER,
        help="answers each frame with one that says VALUE for the signal, with the right checksum "
        "and the next counters",
        value="SI unit",
    ),
    FaultKind(
        name="replay",
        at=ATTACKER,
        help="sends each frame once more, VALUE later",
        value="s",
        default=0.5,
        low=0.0,
        high=1.0,
    ),
    FaultKind(
        name="wrong_length",
        at=ATTACKER,
        help="answers each frame with one of VALUE bytes, with the next counters",
        value="bytes",
        default=4.0,
        low=0.0,
        high=64.0,
    ),
)
"""Every kind of fault, by what can fail so."""


def places(at: str) -> tuple[str, ...]:
    """Return the names of everything that can fail as "signal", "message" and so on."""
    if at == SIGNAL:
        return SIGNALS
    if at == MESSAGE:
        return MESSAGES
    if at == ACTUATOR:
        return tuple(actuators.PLACES)
    if at == NODE:
        return tuple(f"{NODE_PREFIX}{name}" for name in NODES)
    if at == BUS:
        return (BUS,)
    attacked = (*MESSAGES, *SIGNALS, *COMMAND_SIGNALS)
    return tuple(f"{ATTACKER_PREFIX}{name}" for name in attacked)


ALL_AT = (SIGNAL, MESSAGE, ACTUATOR, NODE, BUS, ATTACKER)
PLACES: dict[str, str] = {name: at for at in reversed(ALL_AT) for name in places(at)}
"""What each place is."""


def kinds_at(where: str) -> Iterator[FaultKind]:
    """Yield the kinds of faults that a place can have."""
    of_signal = where.removeprefix(ATTACKER_PREFIX) in (*SIGNALS, *COMMAND_SIGNALS)
    for kind in KINDS:
        if kind.at != PLACES[where] or where in kind.not_at:
            continue
        if kind.sensors_only and where in COMMANDS:
            continue
        if kind.at == ATTACKER and (kind.name == "spoof") != of_signal:
            continue
        yield kind
