"""What a run can be asked for: the keywords of :func:`canroll.run`, in one place."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypedDict


class Choices(TypedDict, total=False):
    """Keywords of a run; what is left out, or None, is the default.

    Attributes:
        vehicle: name or TOML file; "van_real" by default.
        law: control law; "lqg_delay" by default; "passive" for no control at all.
        calibration: file of ``canroll design`` instead of vehicle, law, actuator, observer, tick
            and trigger.
        actuator: "suspension", "bars", "dampers" or "valves".
        observer: "two_sensors", "one_sensor", "propagated" or "reference".
        plant: what is simulated: "roll1" and the other plants of ``plant_sim.bodies``.
        speed_kmh: entry speed; by default the vehicle's own for this manoeuvre.
        bus: profile: "500k", "125k_busy", "gateway_20ms" or "gateway_50ms".
        tick_ms: period of the ECU's loop, 1 to 20.
        phase_ms: from the earliest arrival of an Imu frame to a tick; by default what clocks that
            start together give, which is the seed's.
        trigger: "event" sends a command when it matters, "every" in each tick.
        gains: "computed", or "as_printed" for the numbers of the law's paper.
        feedforward: False leaves the disturbance feedforward out.
        identification: True identifies roll stiffness and damping at run time.
        heartbeat_ms: a command at the latest after; 50 by default.
        backend: what runs the firmware: "native" where a compiler is, "python", "cortex-m4", …
        seed: of sensor noise, bias, phases and background traffic; the same seed, the same bytes.
        duration: s, where shorter than the manoeuvre.
        options: of the manoeuvre, such as ``{"friction": 0.6}``.
        faults: of sensors and actuators, such as "Imu.RollRate=stuck@3:5"; see
            :func:`hil.runs.conditions.options`.
        conditions: of sensors and actuators, such as ``{"supply": 10.0}``.
    """

    vehicle: str | None
    law: str | None
    calibration: str | Path | None
    actuator: str | None
    observer: str | None
    plant: str | None
    speed_kmh: float | None
    bus: str | None
    tick_ms: float | None
    phase_ms: float | None
    trigger: str | None
    gains: str | None
    feedforward: bool | None
    identification: bool | None
    heartbeat_ms: float | None
    backend: str | None
    seed: int | None
    duration: float | None
    options: Mapping[str, Any] | None
    faults: Sequence[str] | None
    conditions: Mapping[str, Any] | None
