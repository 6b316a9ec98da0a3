"""Every attack of the suite driven against one loop, and judged: what got through, with what harm.

A frame of the attacker gets through where its receiver accepts it: the actuator node as it does,
the ECU by its authentication, or on a plain bus by an end-to-end check of the plant's own code.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from canroll.cases.execution import IN_TURN, Cases
from canroll.cases.identity import identity
from canroll.codegen.run.backends import Backend, open_backend
from canroll.codegen.run.bus_firmware import BusFirmware
from canroll.codegen.run.ecu_traffic import Frame, Payload
from canroll.codegen.run.secured import SecuredEcu
from canroll.errors import CanrollError
from canroll.extensions.campaign.attacks.attacker import AttackedWorld
from canroll.extensions.campaign.attacks.kinds import NONE, START_NS, Attack, attacks
from canroll.plant_sim.nodes import codec, e2e
from canroll.plant_sim.nodes.codec import Codec
from canroll.plant_sim.world.world_kernel import row_of
from canroll.reaction import reaction
from canroll.runs.experiment import drive, plan, tick_offset_ns, world_options
from canroll.runs.metrics import peak
from canroll.runs.result import Run
from canroll.runs.trace import Trace
from canroll.runs.virtual_time import closed_loop
from canroll.setup.choices import PASSIVE
from canroll.setup.controller import Controller


class Gate:
    """An ECU whose acceptance of the attacker's frames is counted, as ``accepted``.

    ``arrivals`` says of each frame to come whether it is the attacker's.
    """

    def __init__(
        self,
        ecu: Backend,
        tables: Codec,
        arrivals: Callable[[], bool],
        firmware: BusFirmware,
    ) -> None:
        self._ecu, self._tables, self._arrivals = ecu, tables, arrivals
        self._mailboxes = firmware.slots
        self.accepted = 0
        rows = len(tables.message)
        self._receivers = [e2e.receiver_state(e2e.Supervision()) for _ in range(rows)]

    @property
    def refused(self) -> int:
        """Frames that its authentication has refused; 0 without one."""
        return self._ecu.refused if isinstance(self._ecu, SecuredEcu) else 0

    @property
    def state(self) -> Any:  # noqa: ANN401
        """The state record."""
        return self._ecu.state

    def image(self) -> bytes:
        """The bytes of the state record."""
        return self._ecu.image()

    def restart(self) -> None:
        """Restart."""
        self._ecu.restart()

    def tick(self, elapsed_ticks: int = 1) -> list[Frame]:
        """Run one tick."""
        return self._ecu.tick(elapsed_ticks)

    def receive(self, ident: int, payload: Payload, length: int) -> None:
        """Take a frame, and count it where it is the attacker's and accepted."""
        forged = self._arrivals()
        if isinstance(self._ecu, SecuredEcu):
            before = self._ecu.accepted
            self._ecu.receive(ident, payload, length)
            taken = self._ecu.accepted > before
        else:
            self._ecu.receive(ident, payload, length)
            taken = ident in self._mailboxes and self._in_sequence(ident, payload)
        self.accepted += forged and taken

    def _in_sequence(self, ident: int, payload: Payload) -> bool:
        tables = self._tables
        row = row_of(tables, ident)
        if len(payload) != tables.message[row]["length"]:
            return False
        status = e2e.check(
            self._receivers[row],
            e2e.Supervision(),
            tables.protection[row],
            np.resize(np.frombuffer(bytes(payload), np.uint8), codec.MAX_PAYLOAD),
        )
        return bool(status <= e2e.INITIAL)


@dataclass(frozen=True, slots=True)
class AttackOutcome:
    """What an attack did.

    Attributes:
        attack: its name.
        sent: frames of the attacker.
        accepted: how often the ECU or the actuators accepted one; both hear the Imu.
        refused: frames refused as not authentic, by ECU and actuators; None: no authentication.
        roll_max_deg: largest roll angle.
        wrong_side_max_nm: largest moment to the wrong side.
        wrong_side_s: longest time with more than 500 N·m to the wrong side.
        codes: names of the ECU's fault codes.
        harm: in which ways the run was harmful.
    """

    attack: str
    sent: int
    accepted: int
    refused: tuple[int, int] | None
    roll_max_deg: float
    wrong_side_max_nm: float
    wrong_side_s: float
    codes: tuple[str, ...]
    harm: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Suite:
    """All attacks on one loop, the first one none; ``authenticated``: the frames of its bus are."""

    settings: Run
    authenticated: bool
    passive_roll_deg: float
    outcomes: tuple[AttackOutcome, ...]

    @property
    def accepted(self) -> int:
        """How often a frame of an attacker was accepted."""
        return sum(outcome.accepted for outcome in self.outcomes)

    @property
    def broken(self) -> bool:
        """Whether an attacker's frame was accepted although frames are authenticated."""
        return self.authenticated and self.accepted > 0

    @property
    def verdict(self) -> str:
        """The verdict in one line."""
        sent = sum(outcome.sent for outcome in self.outcomes)
        harmful = sum(bool(outcome.harm) for outcome in self.outcomes[1:])
        kind = "authenticated" if self.authenticated else "not authenticated"
        return (
            f"{self.settings.bus_name}, {kind}: {sent} forged frames, accepted {self.accepted} "
            f"times; {harmful} of {len(self.outcomes) - 1} attacks harmful"
        )

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "bus": self.settings.bus,
            "authenticated": self.authenticated,
            "accepted": self.accepted,
            "verdict": self.verdict,
            "passive_roll_max_deg": self.passive_roll_deg,
            "attacks": [asdict(outcome) for outcome in self.outcomes],
        }


def run(
    scenario: str,
    *,
    named: str = "",
    cases: Cases = IN_TURN,
    **choices: Any,  # noqa: ANN401
) -> Suite:
    """Drive every attack on the loop of ``choices`` (:class:`canroll.setup.choices.Choices`).

    ``named``: attacks whose name contains this.

    Raises:
        CanrollError: an invalid name or number, no such attack, or a bus of several segments.
        VerdictError: the design fails its own checks.
    """
    if choices.get("law") == PASSIVE:
        raise CanrollError("--law passive has no control to attack: choose another law")
    settings, controller = plan(scenario, **choices)
    if settings.profile.segments > 1:
        # what a gateway forwards could not be distinguished from a genuine frame
        raise CanrollError(
            f"bus {settings.bus} has several segments: attacks need a bus of one, such as 500k"
        )
    passive = drive(replace(settings, faults=()), controller, enabled=False)
    chosen = [
        number for number, attack in enumerate(attacks(settings.command)) if named in attack.name
    ]
    if not chosen:
        raise CanrollError(f"no attack has '{named}' in its name")
    study = cases.of(identity(settings, controller) | {"attacks": named})
    loop = study.engine.common((settings, controller, passive))
    arguments = [(loop, number) for number in (None, *study.picked(chosen))]
    outcomes = study.rows(f"attacks on {settings.bus}", attacked, arguments)
    roll = float(np.degrees(peak(passive.signals["roll"])))
    return Suite(settings, settings.firmware.bus.secured, roll, tuple(outcomes))


def attacked(loop: tuple[Run, Controller, Trace], number: int | None) -> AttackOutcome:
    """Drive the attack of a number, or none.

    ``loop``: settings, controller, and the run without control.
    """
    settings, controller, passive = loop
    attack = NONE if number is None else attacks(settings.command)[number]
    settings = replace(settings, faults=(*settings.faults, *attack.faults))
    return outcome(settings, controller, passive, attack)


def outcome(
    settings: Run,
    controller: Controller,
    passive: Trace,
    attack: Attack,
) -> AttackOutcome:
    """Drive one attack and judge it."""
    world = AttackedWorld(**world_options(settings, enabled=True))
    world.attack(attack.forge, START_NS, seed=settings.seed)
    inner = open_backend(
        settings.backend, controller.record, settings.firmware, key=settings.secret
    )
    gate = Gate(inner, world.ear.tables, lambda: world.arrivals.pop(0), settings.firmware)
    trace = closed_loop(
        world,
        gate,
        tick_ns=round(settings.tick * 1e9),
        offset_ns=tick_offset_ns(settings),
    )
    refused = (inner.refused, world.refused) if isinstance(inner, SecuredEcu) else None
    seen = reaction.observe(replace(trace, refused=refused), passive, ())
    return AttackOutcome(
        attack=attack.name,
        sent=world.sent,
        accepted=gate.accepted + world.forged,
        refused=refused,
        roll_max_deg=float(np.degrees(peak(trace.signals["roll"]))),
        wrong_side_max_nm=seen.wrong_side_max_nm,
        wrong_side_s=seen.wrong_side_s,
        codes=tuple(code.name for code in seen.codes),
        harm=seen.harm,
    )
