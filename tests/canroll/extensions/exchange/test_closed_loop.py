"""ECU, bus and plant as FMUs under FMPy exchange the frames of a run, byte for byte."""

import subprocess
import sys
from zipfile import ZipFile

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from support.fmus import importer, transmit

from canroll.cli.main import parse
from canroll.codegen.run.backends import open_backend
from canroll.extensions.exchange.cli import export_fmu
from canroll.plant_sim import can_bus
from canroll.plant_sim.can_bus import ACTUATOR, ECU
from canroll.runs.experiment import build_world, plan
from canroll.runs.virtual_time import closed_loop

pytestmark = pytest.mark.slow

END = 2_500_000_000


@pytest.fixture(scope="module")
def fmus(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fmus")
    for kind in ("ecu", "bus", "plant"):
        export_fmu.run(parse(["export-fmu", kind, str(folder / f"{kind}.fmu")]))
    return folder


@pytest.fixture(scope="module")
def run():
    """World and trace of `canroll run double_lane_change` up to ``END``."""
    settings, controller = plan("double_lane_change")
    world = build_world(settings, enabled=True)
    ecu = open_backend("native", controller.record, settings.firmware)
    trace = closed_loop(world, ecu, tick_ns=10_000_000, duration_ns=END)
    return trace


def received(frames, by):
    """Instants, identifiers and data of frames that a node has received."""
    return [
        (int(f["t_received"]), int(f["ident"]), f["payload"][: f["length"]].tobytes())
        for f in frames
        if f["sender"] != by and f["outcome"] == can_bus.DELIVERED and f["t_received"] < END
    ]


@pytest.mark.long
def test_all_three_meet_the_standard(fmus):
    for kind in ("ecu", "bus", "plant"):
        assert validate_fmu(str(fmus / f"{kind}.fmu")) == []


@pytest.mark.parametrize("kind", ["ecu", "bus", "plant"])
def test_another_process_writes_the_same_sources(fmus, tmp_path, kind):
    again = tmp_path / "again.fmu"
    command = [sys.executable, "-m", "canroll.cli.main", "export-fmu", kind, str(again)]
    subprocess.run(command, check=True, capture_output=True)
    with ZipFile(fmus / f"{kind}.fmu") as one, ZipFile(again) as other:
        for name in one.namelist():
            assert name.endswith(".so") or one.read(name) == other.read(name), name


def test_frames_are_those_of_a_run(fmus, run):
    module = importer()
    parts = {kind: module.Fmu(fmus / f"{kind}.fmu") for kind in ("ecu", "bus", "plant")}
    wires = {}
    for one, other in (
        (("ecu", "CAN"), ("bus", "RollControl")),
        (("plant", "Sensors"), ("bus", "Imu")),
        (("plant", "Actuator"), ("bus", "Actuator")),
    ):
        wires[one], wires[other] = other, one
    heard = {"bus:RollControl": [], "bus:Actuator": []}
    for now, port, ident, data in module.run(parts, wires, END):
        if port in heard:
            heard[port].append((now, ident, data))
    assert heard["bus:RollControl"] == received(run.frames, ECU)
    assert heard["bus:Actuator"] == received(run.frames, ACTUATOR)
    assert sum(1 for _, ident, _ in heard["bus:Actuator"] if ident == 0x81) > 40
    assert parts["plant"].get("roll")[0] == run.signals["roll"][END // 1_000_000 - 1]


def test_plant_moves_as_in_a_run(fmus, run):
    """The plant alone, given the commands of the run when they were received."""
    module = importer()
    plant = module.Fmu(fmus / "plant.fmu")
    commands = [f for f in run.frames if f["sender"] == ECU and f["ident"] == 0x81]
    worst, at = 0.0, 0
    for k in range(1, END // 1_000_000):
        while at < len(commands) and commands[at]["t_received"] <= k * 1_000_000:
            f = commands[at]
            plant.advance(int(f["t_received"]))
            plant.read([])
            data = f["payload"][: f["length"]].tobytes()
            plant.give({"Actuator": transmit(int(f["ident"]), data)})
            at += 1
        plant.advance(k * 1_000_000)
        for name in ("x", "y", "roll", "moment_front", "wheel_load_rear_left", "steer"):
            worst = max(worst, abs(plant.get(name)[0] - run.signals[name][k - 1]))
    assert max(np.abs(run.signals["moment_front"])) > 100
    assert worst < 1e-9


def test_fmpy_simulates_the_plant(fmus):
    result = fmpy.simulate_fmu(str(fmus / "plant.fmu"), stop_time=0.2, step_size=1e-3)
    assert result["x"][-1] == pytest.approx(80 / 3.6 * 0.2, rel=1e-3)


def test_a_plant_follows_the_speed_of_a_file(tmp_path):
    file, model = tmp_path / "drive.csv", tmp_path / "plant.fmu"
    file.write_text("time,steering_wheel_deg,speed_kmh\n0,0,80\n1,0,80\n3,30,60\n4,30,60\n")
    made = ["export-fmu", "plant", str(model), "--scenario", "from_file", "--ports", "signals"]
    export_fmu.run(parse([*made, "--set", f"file={file}"]))
    rows = fmpy.simulate_fmu(str(model), stop_time=4.0, output_interval=0.01, output=["vx"])
    column = np.interp(rows["time"], [0, 1, 3, 4], [80, 80, 60, 60])
    assert 3.6 * rows["vx"] == pytest.approx(column, abs=1.3)
