"""The CAN FD profile of our own bus: closed loop, logs of all formats, its delay and bundle."""

from dataclasses import replace

import can
import cantools
import numpy as np
import pytest
from support.bundles import make

from canroll import dbc
from canroll.cli import main
from canroll.codegen.run import native
from canroll.codegen.run.backends import default_backend, open_backend
from canroll.plant_sim.can_bus import load_profile
from canroll.plant_sim.can_bus.bounds.delay_bounds import delay_bounds
from canroll.plant_sim.can_bus.network.own_frames import own_messages
from canroll.plant_sim.can_bus.traffic.background import utilisation
from canroll.runs import logs
from canroll.runs.experiment import build_world, delay_of, plan
from canroll.runs.virtual_time import closed_loop

DATABASE = cantools.database.load_file(dbc.FD_PATH)
OURS = {message.frame_id: message for message in DATABASE.messages}


def drive(bus, seed=1, duration_ns=1_500_000_000):
    named = {"law": "lqr", "actuator": "suspension", "plant": "roll1"}
    settings, controller = plan("double_lane_change", seed=seed, bus=bus, **named)
    ecu = open_backend(default_backend(), controller.record, settings.firmware)
    world = build_world(settings, enabled=True)
    trace = closed_loop(world, ecu, tick_ns=10_000_000, duration_ns=duration_ns)
    return settings, trace


@pytest.fixture(scope="module")
def driven():
    return drive("fd_2m")


@pytest.mark.parametrize("suffix", [".asc", ".blf", ".mf4", ".pcap"])
def test_logs_have_fd_frames_that_cantools_decodes(driven, tmp_path, suffix):
    path = logs.write_log(tmp_path / f"bus{suffix}", driven[1].frames)
    seen = {}
    with can.LogReader(path) as log:
        for frame in log:
            if frame.arbitration_id in OURS and not frame.is_error_frame:
                assert frame.is_fd and frame.bitrate_switch
                message = OURS[frame.arbitration_id]
                assert len(frame.data) == message.length
                values = message.decode(bytes(frame.data), decode_choices=False)
                seen.setdefault(message.name, []).append(values)
    assert len(seen["SensorCluster"]) >= 149
    for name in ("TravelFrontLeft", "LongitudinalAcceleration", "RollRate", "RateRearRight"):
        assert len({values[name] for values in seen["SensorCluster"]}) > 5
    # the sample counter and the counter of profile 5 go on with every frame
    for name, values in (("SampleCounter", 16), ("Counter", 256)):
        counts = np.array([row[name] for row in seen["SensorCluster"]])
        assert (np.diff(counts) % values == 1).all()


def test_the_loop_runs_undisturbed(driven):
    ticks = driven[1].ticks[60:]
    assert (ticks["mode"] == 1).all()
    assert (ticks["fault_codes"] == 0).all()


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_ages_lie_within_the_bounds(seed):
    settings, trace = drive("fd_2m", seed=seed)
    bound = delay_of(settings)
    assert len(trace.ages) > 20
    assert trace.ages.min() * 1e-9 >= bound.least - settings.vehicle.sensors.roll_rate.latency
    assert trace.ages.max() * 1e-9 <= bound.most


def test_our_frames_alone_wait_less_than_on_the_classic_bus():
    """At equal load the background grows by what our frames leave: here there is none."""
    profiles = []
    for name in ("500k", "fd_2m"):
        profile = load_profile(name)
        own = own_messages(profile=profile)
        taken = utilisation(own, profile.bitrate, profile.data_bitrate)
        profiles.append(replace(profile, load=taken))
    classic, fd = (delay_bounds(profile) for profile in profiles)
    assert profiles[1].load < 0.5 * profiles[0].load
    assert fd.age_max < classic.age_max
    assert fd.command.greatest < 0.7 * classic.command.greatest


@pytest.mark.long
@pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler")
def test_its_bundle_has_the_fd_firmware(tmp_path):
    words = "--bus fd_2m --law lqr --actuator suspension"
    assert main.main(["export-c", str(tmp_path), *words.split()]) == 0
    assert "32, CAN FD with BRS" in (tmp_path / "README.md").read_text()
    result = make(tmp_path, "test")
    assert result.returncode == 0, result.stderr
    assert "PASS" in result.stdout
