"""The compiled loop and the one that calls every tick from Python give the same bytes."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from canroll.codegen.run import native
from canroll.errors import CanrollError
from canroll.plant_sim.can_bus import build_network
from canroll.plant_sim.can_bus.simulation.response_times import delivered, traffic_spec
from canroll.plant_sim.can_bus.traffic.messages import BusMessage
from canroll.plant_sim.kernels import records
from canroll.plant_sim.world import world as world_module
from canroll.runs import experiment, virtual_time
from canroll.runs.logs import write_log

pytestmark = pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler (cc)")

ROOT = Path(__file__).parents[3]
OWN_BUS = {
    "dbc": str(ROOT / "examples" / "own_bus" / "own.dbc"),
    "map": str(ROOT / "examples" / "own_bus" / "own.toml"),
}
OWN_FD = {
    "dbc": str(ROOT / "dbc" / "roll_control_fd.dbc"),
    "map": str(ROOT / "dbc" / "roll_control_fd.toml"),
}


def interpreted(monkeypatch):
    monkeypatch.setattr(virtual_time, "compiled_ticks", virtual_time.observed_ticks)


def everything(result):
    """All bytes of a result: figures, warnings, signals, frames, ages and ticks."""
    found = [json.dumps(result.to_json(), sort_keys=True)]
    for trace in (result.passive, result.controlled, result.replay):
        if trace is not None:
            assert len(trace.ticks)
            found += [(name, np.asarray(trace.signals[name]).tobytes()) for name in trace.signals]
            found += [trace.frames.tobytes(), trace.ages.tobytes(), trace.ticks.tobytes()]
            found.append(repr((trace.duration, trace.complete)))
    return found


def assert_same(monkeypatch, settings, controller, **options):
    compiled = everything(experiment.simulate(settings, controller, **options))
    with monkeypatch.context() as patched:
        interpreted(patched)
        assert everything(experiment.simulate(settings, controller, **options)) == compiled
    return compiled


@pytest.fixture(scope="module")
def planned():
    return experiment.plan("double_lane_change", law="lqr", actuator="suspension")


VARIED = {
    "nominal": {},
    "125k_busy": {"bus": "125k_busy"},
    "gateway_20ms": {"bus": "gateway_20ms"},
    "gateway_50ms": {"bus": "gateway_50ms"},
    "fd_2m": {"bus": "fd_2m"},
    "roll1": {"plant": "roll1"},
    "linear_car": {"plant": "linear_car"},
    "moose": {"scenario": "moose"},
    "random_road": {"scenario": "random_road"},
    "rollover": {"scenario": "fishhook", "speed": 120 / 3.6, "options": (("friction", 1.4),)},
    "phase": {"phase": 2.5e-3},
    "seed": {"seed": 12},
    "sensor_faults": {"faults": ("Imu.RollRate=invalid@1:3", "Imu.YawRate=burst:0.2@1")},
    "silence": {"faults": ("Imu=dropout@2:3",)},
    "actuator_faults": {"faults": ("front_left=weak:0.3@1", "rear_right=stuck@2")},
    "no_power": {"faults": ("node.RollControl=down@1.003:1.5", "node.RollControl=down@2:2.001")},
    "reset": {"faults": ("node.RollControl=reset:0.2@1",)},
    "attack": {"faults": ("Imu.RollRate=drift:0.1@1", "Imu=frozen@2")},
    "noise": {"conditions": (("noise", 5.0), ("drift", 1.0), ("temperature", 40.0))},
    "clocks": {"conditions": (("phases.Imu", 0.004), ("lsb.Imu.RollRate", 0.01))},
    "synchronous": {"conditions": (("synchronous", True), ("delayed", False))},
    "supply": {"conditions": (("supply", 10.0), ("estimate_error", -0.1))},
}


@pytest.mark.parametrize("change", VARIED.values(), ids=VARIED)
def test_a_run_is_the_same(monkeypatch, planned, change):
    settings, controller = planned
    assert_same(monkeypatch, replace(settings, **change), controller, duration=4.0)


def test_a_rollover_ends_both(planned):
    settings, controller = planned
    rolls = replace(settings, **VARIED["rollover"])
    assert experiment.drive(rolls, controller, enabled=True).duration < 4.0


DESIGNS = {
    "default": {},
    "bars_every": {"law": "lqr", "actuator": "bars", "trigger": "every"},
    "dampers": {"law": "lqr", "actuator": "dampers", "observer": "one_sensor"},
    "valves": {"law": "lqr_full_car", "actuator": "valves", "plant": "linear_car"},
    "5_ms": {"law": "ay_feedforward", "tick_ms": 5.0},
    "identification": {"law": "lqr", "identification": True, "offset_learning": True},
    "printed": {
        "law": "hinf_delay",
        "gains": "theorem",
        "unverified": True,
        "actuator": "suspension",
    },
    "own_bus": {"law": "lqr", **OWN_BUS},
    "own_fd": {"law": "lqr", **OWN_FD},
    "secured_fd": {"law": "lqr", "bus": "secured_fd"},
    "stage": {"law": "lqr", "stage": str(ROOT / "examples" / "own_stage" / "progressive.py")},
    "1_ms": {"law": "lqr", "tick_ms": 1.0},
}


@pytest.mark.slow
@pytest.mark.parametrize("choices", DESIGNS.values(), ids=DESIGNS)
def test_every_kind_of_controller_is_the_same(monkeypatch, choices):
    settings, controller = experiment.plan("double_lane_change", **choices)
    assert_same(monkeypatch, settings, controller, duration=3.0)


def recording(path):
    """A log of five seconds of other frames."""
    messages = [
        BusMessage(f"m{k}", 0x11 + 0x10 * k, 8, (7, 13, 31)[k % 3] * 1.01e6, f"n{k % 3}")
        for k in range(8)
    ]
    network = build_network(traffic_spec(messages, bitrate=500_000, seed=3))
    return f"{write_log(path, np.concatenate([*delivered(network, 5_000_000_000)]))}@500000"


def test_a_recorded_bus_is_the_same(monkeypatch, planned, tmp_path):
    settings, controller = planned
    recorded = replace(settings, bus=recording(tmp_path / "bus.blf"))
    # more than one pass of the recording
    assert_same(monkeypatch, recorded, controller)


def test_progress_is_the_same(monkeypatch, planned):
    settings, controller = planned

    def shares():
        found = []
        experiment.drive(settings, controller, enabled=True, progress=lambda *a: found.append(a))
        return found

    compiled = shares()
    interpreted(monkeypatch)
    assert shares() == compiled
    assert len(compiled) > 10


def test_an_interrupted_run_keeps_every_tick(monkeypatch, planned):
    """Ctrl-C during a call of the kernel arrives once it returns."""
    settings, controller = planned
    calls = []

    def interrupted_run(kernel, types):
        def run(*arguments):
            calls.append(kernel(*arguments))
            if len(calls) == 3:
                raise KeyboardInterrupt

        return run if kernel is world_module.run else records.entry(kernel, types)

    whole = experiment.drive(settings, controller, enabled=True)
    monkeypatch.setattr(world_module, "entry", interrupted_run)
    with pytest.raises(virtual_time.Interrupted) as caught:
        experiment.drive(settings, controller, enabled=True)
    trace = caught.value.trace
    assert not trace.complete
    assert len(trace.ticks) == sum(calls) > 100
    assert trace.ticks.tobytes() == whole.ticks[: len(trace.ticks)].tobytes()
    assert trace.duration == pytest.approx(trace.ticks["t"][-1])
    assert len(trace.signals["roll"]) == round(1e3 * trace.duration)


def test_a_frame_that_the_bus_cannot_carry_is_refused(planned):
    settings, _ = planned
    world = experiment.build_world(settings, enabled=True)
    ecu = SimpleNamespace(firmware=SimpleNamespace(sent=((0x80, 8), (0x123, 64)), messages={}))
    with pytest.raises(CanrollError, match="frame 0x123 of 64 bytes: the ECU sends classic"):
        virtual_time.connected(world, ecu)
