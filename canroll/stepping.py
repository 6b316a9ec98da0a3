"""A manoeuvre driven tick by tick, for code of your own between the ticks."""

from collections.abc import Mapping
from typing import Any, Unpack

from canroll.codegen.run.backends import open_backend
from canroll.reaction.fault_codes import MODES
from canroll.runs.experiment import build_world, plan, tick_offset_ns
from canroll.runs.result import Run
from canroll.runs.virtual_time import ticks
from canroll.setup.choices import PASSIVE, Choices
from canroll.setup.controller import Controller


class SteppedDrive:
    """A car, its bus and its ECU in virtual time, one tick of the ECU a step.

    Attributes:
        settings: of the run.
        time: since the start, s.
        signals: of the last millisecond, by name, SI units; empty before the first step.
    """

    def __init__(self, settings: Run, controller: Controller) -> None:
        self.settings = settings
        self.time = 0.0
        self.signals: Mapping[str, float] = {}
        self._world = build_world(settings, enabled=settings.law != PASSIVE)
        self._ecu = open_backend(
            settings.backend, controller.record, settings.firmware, key=settings.secret
        )
        self._ticks = ticks(
            self._world,
            self._ecu,
            tick_ns=round(settings.tick * 1e9),
            end_ns=self._world.duration_ns,
            offset_ns=tick_offset_ns(settings),
        )

    def step(self) -> bool:
        """Drive on to the next tick; return False once the manoeuvre is over."""
        t_ns = next(self._ticks, None)
        self.time = 1e-9 * self._world.now_ns
        self.signals = self._world.signals.last()
        return t_ns is not None

    @property
    def ecu(self) -> Any:  # noqa: ANN401 - the record is of the firmware for the bus
        """The ECU's state, integers in the formats of :mod:`canroll.firmware.state`."""
        return self._ecu.state

    @property
    def mode(self) -> str:
        """The ECU's mode: INIT, ACTIVE, DEGRADED or SAFE."""
        return MODES[int(self._ecu.state.mode)]

    def __repr__(self) -> str:
        return f"<{self.settings.scenario}, {self.settings.vehicle_name}, at {self.time:.2f} s>"


def drive(scenario: str, **choices: Unpack[Choices]) -> SteppedDrive:
    """Return a manoeuvre at time 0, to be driven tick by tick with :meth:`SteppedDrive.step`.

    With the same choices it moves as the controlled run of :func:`canroll.run`, with law "passive"
    as the run without control.

    Args:
        scenario: name of the manoeuvre.
        choices: as for :func:`canroll.run`.

    Raises:
        CanrollError: an invalid name, number or file.
        VerdictError: the design fails its own checks.
    """
    return SteppedDrive(*plan(scenario, **choices))
