"""The closed loop on authenticated frames, judged frame by frame with the cryptography package."""

import json
import os

import numpy as np
import pytest
from cryptography.hazmat.primitives.ciphers import algorithms
from cryptography.hazmat.primitives.cmac import CMAC

from canroll import dbc
from canroll.cli.main import main
from canroll.codegen.run import cortex
from canroll.codegen.run.backends import open_backend
from canroll.dbc.keys import DEVELOPMENT_KEY
from canroll.errors import CanrollError
from canroll.firmware.state import ACTIVE
from canroll.plant_sim.can_bus import load_profile
from canroll.report.run_folder import write_files
from canroll.runs import experiment, saved_run
from canroll.runs.experiment import build_world, drive, plan
from canroll.runs.virtual_time import closed_loop
from canroll.setup.delay import sample_to_force

LANE_CHANGE = "double_lane_change"
SHORT = {"duration": 3.0, "bus": "secured_fd"}


@pytest.fixture(scope="module")
def run():
    return experiment.run(LANE_CHANGE, **SHORT)


def ours(trace):
    idents = {message.frame_id: dbc.data_id(message) for message in dbc.load().messages}
    for entry in trace.frames:
        if int(entry["ident"]) in idents and entry["outcome"] == 0:
            yield idents[int(entry["ident"])], entry


@pytest.mark.slow
def test_every_frame_is_authentic_by_another_implementation(run):
    last = {}
    for identity, entry in ours(run.controlled):
        data = bytes(entry["payload"][: entry["length"]])
        assert len(data) == 20
        starts, count = (int.from_bytes(data[at : at + 3], "big") for at in (8, 11))
        judge = CMAC(algorithms.AES(DEVELOPMENT_KEY))
        judge.update(identity.to_bytes(2, "big") + data[:14])
        assert data[14:] == judge.finalize()[:6]
        assert (starts, count) == (1, last.get(identity, -1) + 1)
        last[identity] = count
    assert len(last) == 8
    assert run.refused == (0, 0)


def test_control_helps_as_on_the_plain_bus(run):
    plain = experiment.run(LANE_CHANGE, duration=3.0)
    assert plain.refused is None
    assert plain.to_json()["authentication"] is None
    assert run.controlled_metrics.roll_max_deg == pytest.approx(
        plain.controlled_metrics.roll_max_deg, rel=0.05
    )
    assert run.to_json()["authentication"] == {
        "key": "development",
        "refused": {"ecu": 0, "actuators": 0},
    }


def test_the_design_counts_on_the_delay_of_this_bus(run):
    settings = run.settings
    expected = sample_to_force(settings.vehicle, settings.command, load_profile("secured_fd"))
    assert run.delay == expected
    ages = np.asarray(run.controlled.ages) * 1e-9
    assert 0 < ages.max() <= expected.most


def test_it_is_saved_and_comes_back(run, tmp_path):
    write_files(run, tmp_path)
    again = saved_run.load(tmp_path)
    assert again.refused == (0, 0)
    assert again.to_json()["authentication"] == run.to_json()["authentication"]


@pytest.mark.parametrize("backend", ["python", "native"])
def test_a_node_with_another_key_hears_nothing(backend):
    settings, controller = plan(LANE_CHANGE, bus="secured_fd")
    trace = closed_loop(
        build_world(settings, enabled=True),
        open_backend(backend, controller.record, settings.firmware, key=bytes(16)),
        tick_ns=10_000_000,
        duration_ns=500_000_000,
    )
    ecu, actuators = trace.refused
    assert ecu == sum(1 for _, entry in ours(trace) if 0x90 < entry["ident"] < 0x300)
    # it never leaves INIT, so that no command of it goes out
    assert actuators == 0
    assert not (trace.ticks["mode"] == ACTIVE).any()
    assert len(trace.ages) == 0


@pytest.mark.parametrize(
    "fault", ["node.RollControl=reset:0.2@1", "node.Actuator=reset:0.2@1", "node.Imu=reset:0.2@1"]
)
def test_every_node_comes_back_after_a_reset(fault):
    settings, controller = plan(LANE_CHANGE, bus="secured_fd", faults=[fault])
    trace = drive(settings, controller, enabled=True, duration=3.0)
    assert trace.refused == (0, 0)
    late = trace.ticks["t"] > 2.0
    assert (trace.ticks["mode"][late] == ACTIVE).all()
    applied = np.abs(trace.signals["moment_front"][-500:])
    assert applied.max() > 0


@pytest.mark.slow
@pytest.mark.skipif(not cortex.has_pip_tools(), reason="needs canroll[target]")
@pytest.mark.parametrize("actuator", ["bars", "dampers"])
def test_a_tick_pays_at_most_9000_instructions(actuator, capsys):
    command = ["timing", "--bus", "secured_fd", "--counter", "unicorn", "--processor", "cortex-m4"]
    assert main([*command, "--duration", "1.2", "--actuator", actuator, "--json"]) == 0
    its = json.loads(capsys.readouterr().out)
    assert its["authentication_instructions"]["mean"] > 1000
    assert its["authentication_instructions"]["max"] <= 9000
    assert its["instructions"]["max"] > its["authentication_instructions"]["max"]


def test_an_own_key_is_used_and_never_shown(tmp_path, capsys):
    path = tmp_path / "bus.key"
    path.write_text("000102030405060708090a0b0c0d0e0f", encoding="utf-8")
    path.chmod(0o600)
    out = tmp_path / "out"
    arguments = ["run", LANE_CHANGE, "--bus", "secured_fd", "--duration", "1"]
    main([*arguments, "--key", str(path), "--out", str(out)])
    shown = capsys.readouterr().out
    assert "frames authenticated with the key of --key; refused: 0 by the ECU, 0 by" in shown
    for file in out.iterdir():
        assert b"000102030405060708090a0b0c0d0e0f" not in file.read_bytes().lower()
        assert bytes(range(16)) not in file.read_bytes()
    main(arguments)
    assert "the public development key" in capsys.readouterr().out


def test_a_key_without_use_or_in_reach_of_others_is_refused(tmp_path):
    path = tmp_path / "bus.key"
    path.write_text("000102030405060708090a0b0c0d0e0f", encoding="utf-8")
    os.chmod(path, 0o600)
    with pytest.raises(CanrollError, match="frames of bus 500k are not authenticated: omit it"):
        plan(LANE_CHANGE, key=str(path))
    os.chmod(path, 0o644)
    with pytest.raises(CanrollError, match="chmod 600"):
        plan(LANE_CHANGE, key=str(path), bus="secured_fd")
