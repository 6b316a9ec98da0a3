"""The Imu node is driven off the bus in the middle of a manoeuvre: seen from every side."""

import numpy as np
import pytest

from canroll import dbc
from canroll.codegen.run.backends import open_backend
from canroll.plant_sim.can_bus import DELIVERED, ERROR, IMU, OUTCOMES, account, load_profile
from canroll.plant_sim.driving import maneuvers
from canroll.plant_sim.faults import parse
from canroll.plant_sim.world.world import World
from canroll.runs import experiment, virtual_time

START, END = 1_500_000_000, 1_900_000_000
ACTIVE, SAFE = 1, 3


@pytest.fixture(scope="module")
def disturbed():
    settings, controller = experiment.plan(
        "double_lane_change", vehicle="van_real", backend="python"
    )
    world = World(
        vehicle=settings.vehicle,
        body=settings.plant,
        actuator=settings.actuator,
        maneuver=maneuvers.build("double_lane_change", settings.vehicle, settings.speed, 0),
        profile=load_profile("500k"),
        command=settings.command,
        faults=parse(f"node.Imu=bus_off@{START * 1e-9}:{END * 1e-9}"),
    )
    ecu = open_backend("python", controller.record)
    trace = virtual_time.closed_loop(
        world, ecu, tick_ns=round(settings.tick * 1e9), duration_ns=4 * 10**9
    )
    return world, trace


def test_every_frame_of_the_imu_is_accounted_for(disturbed):
    world, trace = disturbed
    assert account(world.network, 0).balanced
    imu = dbc.load().get_message_by_name("Imu").frame_id
    log = trace.frames[trace.frames["ident"] == imu]
    ends = log[log["outcome"] != ERROR]
    # one frame every 10 ms, each with exactly one end
    assert len(ends) == pytest.approx(400, abs=2)
    inside = ends[(ends["t_received"] > START) & (ends["t_received"] < END)]
    reasons = {OUTCOMES[code] for code in np.unique(inside["outcome"])}
    assert "lost: bus-off" in reasons
    assert "delivered" not in reasons
    after = ends[ends["t_queued"] > END + 50_000_000]
    assert (after["outcome"] == DELIVERED).all()
    assert world.network.nodes["bus_offs"][IMU] >= 10


def test_the_ecu_goes_to_safe_and_comes_back(disturbed):
    _, trace = disturbed
    status = dbc.load().get_message_by_name("RollControlStatus")
    frames = trace.frames[
        (trace.frames["ident"] == status.frame_id) & (trace.frames["outcome"] == DELIVERED)
    ]
    modes = [
        (
            int(f["t_queued"]),
            status.decode(bytes(f["payload"][:8]), decode_choices=False)["Mode"],
        )
        for f in frames
    ]
    before = [mode for t, mode in modes if 1_000_000_000 < t < START]
    inside = [mode for t, mode in modes if START + 250_000_000 < t < END]
    after = [mode for t, mode in modes if t > 3_500_000_000]
    assert set(before) == {ACTIVE}
    assert set(inside) == {SAFE}
    assert set(after) == {ACTIVE}
