"""Traffic of driven manoeuvres, recorded in closed loop, for all laws, actuators and observers.

A random calibration in random traffic is mostly in SAFE. Here the loop is active: each recording is
a design of the gain generator on its own plant.
"""

from dataclasses import dataclass

from canroll.codegen.run.backends import Recorder, open_backend
from canroll.codegen.run.ecu_traffic import EcuTraffic
from canroll.firmware.calibration import Calibration
from canroll.runs.experiment import build_world, plan
from canroll.runs.virtual_time import closed_loop

DURATION = 10.0


@dataclass(frozen=True, slots=True)
class Case:
    """A design and the run that it drives."""

    scenario: str
    law: str
    actuator: str = "suspension"
    observer: str | None = None
    trigger: str | None = None
    identification: bool = False
    response_watch: bool | None = None
    bus: str | None = None


CASES = (
    Case("double_lane_change", "lqr"),
    Case("j_turn", "lqr", observer="one_sensor"),
    Case("double_lane_change", "lqr", observer="propagated", identification=True),
    Case("j_turn", "lqr", observer="steering", trigger="event"),
    Case("double_lane_change", "lqr", actuator="bars", observer="acceleration"),
    Case("j_turn", "lqr", observer="acceleration_propagated"),
    Case("double_lane_change", "lqr", observer="reference"),
    Case("double_lane_change", "lqr", actuator="bars"),
    Case("double_lane_change", "lqr", actuator="dampers"),
    Case("j_turn", "hinf_delay"),
    Case("double_lane_change", "hinf_nodelay"),
    Case("double_lane_change", "hinf_event", trigger="event"),
    Case("double_lane_change", "lqg_delay", actuator="bars"),
    Case("j_turn", "hinf"),
    Case("double_lane_change", "smc", actuator="bars", observer="propagated"),
    Case("j_turn", "rate_feedforward"),
    Case("double_lane_change", "ay_feedforward", actuator="dampers"),
    Case("double_lane_change", "lqr_full_car", actuator="valves"),
)


@dataclass(frozen=True, slots=True)
class Recording:
    """A case with its calibration and the frames its ECU received."""

    case: Case
    calibration: Calibration
    traffic: EcuTraffic


def record(case: Case, duration: float = DURATION) -> Recording:
    """Design and drive a case for ``duration`` s."""
    settings, controller = plan(
        case.scenario,
        law=case.law,
        actuator=case.actuator,
        observer=case.observer,
        trigger=case.trigger,
        identification=case.identification or None,
        response_watch=case.response_watch,
        bus=case.bus,
    )
    firmware = settings.firmware
    recorder = Recorder(open_backend(settings.backend, controller.record, firmware), firmware)
    closed_loop(
        build_world(settings, enabled=True),
        recorder,
        tick_ns=round(settings.tick * 1e9),
        duration_ns=round(duration * 1e9),
    )
    return Recording(case, controller.record, recorder.traffic)


def recordings(duration: float = DURATION) -> list[Recording]:
    """Every case, recorded."""
    return [record(case, duration) for case in CASES]
