"""The attacks of the suite, each as what an attacker sends in a millisecond."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import wraps
from typing import Concatenate, ParamSpec

from canroll.extensions.campaign.attacks.attacker import Ear, Forge, Forged, Heard
from canroll.plant_sim.can_bus.wire.frame import BIT_RATE_SWITCH, EXTENDED, FD
from canroll.plant_sim.kernels.instants import MS
from canroll.plant_sim.nodes import authentication
from canroll.plant_sim.nodes.actuators import command_signals

START_NS = 2_000 * MS
"""The lane change is under way."""
RESET_S, DOWN_S = 2.6, 0.2
"""When a node loses its power, and for how long (s)."""
BACK_NS = round((RESET_S + DOWN_S) * 1e9)
LISTENING_NS = 300 * MS
"""For so long after a node is back it is sent what was recorded before."""
VALUES = {
    "AntiRollBarCommand": (2000.0, 2000.0),
    "SuspensionForceCommand": (3000.0, -3000.0, 3000.0, -3000.0),
    "DamperCommand": (0.0, 0.0, 0.0, 0.0),
    "ValveCommand": (0.02, 0.02),
}
"""What a spoofed command says, by channel (SI units)."""
PER_TURN = 3
"""Frames of a flood in a millisecond."""


@dataclass(frozen=True, slots=True)
class Attack:
    """One attack: its name, what it sends, and the faults of nodes that it waits for."""

    name: str
    forge: Forge
    faults: tuple[str, ...] = ()


def attacks(command: str) -> tuple[Attack, ...]:
    """Return all attacks on a loop that commands its actuators by ``command``."""
    command_values = dict(zip(command_signals(command), VALUES[command], strict=True))
    first = dict([next(iter(command_values.items()))])
    sensors = {
        "Imu": ({"LateralAcceleration": 6.0}, {"RollRate": 0.5}),
        "VehicleMotion": ({"VehicleSpeed": 2.0}, {"SteeringWheelAngle": -1.5}),
        "SuspensionRate": ({"RateFrontLeft": 0.4, "RateRearLeft": 0.4},),
        "ActuatorState": ({"DeliveredMomentFront": 2000.0, "DeliveredMomentRear": 2000.0},),
    }
    spoofed = [(command, first), (command, command_values)]
    spoofed += [(message, values) for message, all_of in sensors.items() for values in all_of]
    both = (command, "Imu")
    offered = [
        Attack(f"spoofed {message}: {', '.join(values)}", spoof(message, values))
        for message, values in spoofed
    ]
    for message in both:
        offered += [
            Attack(f"{message} replayed after 0.1 s", replay(message, 100 * MS)),
            Attack(f"{message} replayed after 1 s", replay(message, 1000 * MS)),
            Attack(f"first {message} replayed", replay_first(message)),
            Attack(f"{message} with bit flips", flip(message)),
            Attack(f"{message} with a random MAC", guess(message)),
            Attack(f"{message} with the bytes of another", disguise(message)),
            Attack(f"{message} of another length", resize(message, (0, 4, 7, 12, 16, 64))),
            Attack(f"{message} as classic for FD, FD for classic", reformat(message, FD)),
            Attack(f"{message} with 29 bits", reformat(message, EXTENDED)),
            Attack(f"{message}, freshness jump by 1000", jump(message, 1000)),
            Attack(f"{message}, freshness jump by 8 million", jump(message, 1 << 23)),
            Attack(f"{message} of a later start", jump(message, authentication.COUNTS)),
            Attack(f"{message} of a start far ahead", jump(message, 1 << 47)),
            Attack(f"flood of {message}", flood(message)),
        ]
    offered += [
        Attack(
            f"recorded {message} after a reset of {node}",
            after_reset(message),
            (f"node.{node}=reset:{DOWN_S}@{RESET_S}",),
        )
        for node, message in (("RollControl", "Imu"), ("Actuator", command), ("Imu", "Imu"))
    ]
    return tuple(offered)


P = ParamSpec("P")


def answering(
    answer: Callable[Concatenate[Ear, Heard, P], Iterator[Forged]],
) -> Callable[Concatenate[str, P], Forge]:
    """Return the attack that answers each frame of a message, the first argument, by ``answer``."""

    @wraps(answer)
    def attack(message: str, /, *args: P.args, **others: P.kwargs) -> Forge:
        def forge(ear: Ear) -> Iterator[Forged]:
            for heard in ear.heard(message):
                yield from answer(ear, heard, *args, **others)

        return forge

    return attack


def spoof(message: str, values: Mapping[str, float]) -> Forge:
    """Answer each frame with one that says other ``values``, right in all but the MAC."""

    def forge(ear: Ear) -> Iterator[Forged]:
        for heard in ear.heard(message):
            payload = ear.following(heard)
            for signal, value in values.items():
                ear.insert(payload, message, signal, value)
            yield ear.forged(heard.row, ear.finished(heard.row, payload))

    return forge


@answering
def replay(ear: Ear, heard: Heard, delay_ns: int) -> Iterator[Forged]:
    """Send each frame once more."""
    yield ear.forged(heard.row, heard.payload, delay_ns)


@answering
def replay_first(ear: Ear, heard: Heard) -> Iterator[Forged]:
    """Answer each frame with the first that was heard."""
    first = next(old for old in ear.all if old.row == heard.row)
    yield ear.forged(heard.row, first.payload)


@answering
def flip(ear: Ear, heard: Heard) -> Iterator[Forged]:
    """Answer each frame with one that has a wrong bit, its checksum right or not."""
    payload = ear.following(heard)
    bit = int(ear.random.integers(8 * heard.length))
    payload[bit // 8] ^= 1 << bit % 8
    if ear.random.random() < 0.5:
        ear.finished(heard.row, payload)
    yield ear.forged(heard.row, payload)


@answering
def guess(ear: Ear, heard: Heard) -> Iterator[Forged]:
    """Answer each frame with one of a random MAC; on a plain bus, of random signals."""
    payload = ear.following(heard)
    at = slice(authentication.MAC_AT, authentication.SECURED)
    if not ear.secured:
        at = slice(2, heard.length)
    payload[at] = ear.random.integers(0, 256, at.stop - at.start)
    yield ear.forged(heard.row, ear.finished(heard.row, payload))


@answering
def disguise(ear: Ear, heard: Heard) -> Iterator[Forged]:
    """Answer each frame with the newest bytes of another message of the same direction."""
    others = (old for old in reversed(ear.all) if old.row != heard.row)
    other = next(others, None)
    if other is not None:
        yield ear.forged(heard.row, ear.finished(heard.row, ear.following(other)))


@answering
def resize(ear: Ear, heard: Heard, lengths: tuple[int, ...]) -> Iterator[Forged]:
    """Answer each frame with one of another length."""
    flags = int(ear.tables.message[heard.row]["flags"])
    payload = ear.finished(heard.row, ear.following(heard))
    fit = [n for n in lengths if n != heard.length and (n <= 8 or flags & FD)]
    length = fit[int(ear.random.integers(len(fit)))]
    yield Forged(heard.row, length, flags, payload)


@answering
def reformat(ear: Ear, heard: Heard, flag: int) -> Iterator[Forged]:
    """Answer each frame with one of the other format."""
    flags = heard.flags ^ flag
    if not flags & FD:
        flags &= ~BIT_RATE_SWITCH
    length = heard.length if flags & FD else min(heard.length, 8)
    payload = ear.finished(heard.row, ear.following(heard))
    yield Forged(heard.row, length, flags, payload)


@answering
def jump(ear: Ear, heard: Heard, ahead: int) -> Iterator[Forged]:
    """Answer each frame with the same bytes and a later freshness value."""
    payload = ear.following(heard)
    if ear.secured:
        ear.jump(payload, ahead)
    yield ear.forged(heard.row, ear.finished(heard.row, payload))


def flood(message: str) -> Forge:
    """Send frames as fast as the bus takes them, right in all but the MAC."""
    newest: list[Heard] = []

    def forge(ear: Ear) -> Iterator[Forged]:
        newest[:] = ear.heard(message)[-1:] or newest
        for heard in newest:
            payload = heard.payload.copy()
            for _ in range(PER_TURN):
                payload = ear.finished(heard.row, payload.copy())
                if ear.secured:
                    ear.jump(payload, 1)
                yield ear.forged(heard.row, payload)
            newest[:] = [Heard(heard.t_ns, heard.row, heard.length, heard.flags, payload)]

    return forge


def after_reset(message: str) -> Forge:
    """Send a node that has just started what was recorded before, in order."""

    def forge(ear: Ear) -> Iterator[Forged]:
        since = ear.now_ns - BACK_NS
        if not 0 <= since < LISTENING_NS:
            return
        row = ear.leader(message)
        recorded = [old for old in ear.all if old.row == row and old.t_ns < BACK_NS]
        recorded = recorded[-LISTENING_NS // MS :]
        if since // MS < len(recorded):
            yield ear.forged(row, recorded[since // MS].payload)

    return forge


def nothing(ear: Ear) -> Iterator[Forged]:
    """Send nothing."""
    yield from ()


NONE = Attack("none", nothing)
