"""Whole runs through firmware, bus and vehicle, held against packages that are not ours."""

import itertools
import json
from dataclasses import replace
from pathlib import Path

import can
import cantools
import e2e
import numpy as np
import pytest
import tomli_w

import canroll.gain_gen.design as designing
from canroll import dbc, vehicles
from canroll.cli.main import main
from canroll.codegen.run.backends import PythonEcu
from canroll.errors import CanrollError, UnknownNameError
from canroll.gain_gen.calibration import calibration_file
from canroll.plant_sim.can_bus import DELIVERED
from canroll.plant_sim.nodes import sensors
from canroll.report.run_folder import write_files
from canroll.runs import experiment, limit_cycle, saved_run
from canroll.runs.logs import write_log
from canroll.setup import controller as prepared

SHORT = 2.5
OWN_BUS = Path(__file__).parents[3] / "examples" / "own_bus" / "own"


@pytest.fixture(scope="module")
def van_real():
    return experiment.run("double_lane_change", vehicle="van_real")


@pytest.fixture(scope="module")
def gateway(tmp_path_factory):
    """The gain of the paper's theorem for 500 kbit/s, behind a gateway that it never heard of."""
    theorem = {"law": "hinf_delay", "gains": "theorem", "unverified": True}
    designed = prepared.prepare({**theorem, "actuator": "bars"})
    path = tmp_path_factory.mktemp("design") / "calibration.toml"
    calibration_file.save(path, designed.record, designed.tables)
    return experiment.run("double_lane_change", calibration=path, bus="gateway_50ms")


def identities(frames):
    names = ["t_queued", "t_start", "t_received", "segment", "sender", "ident", "length", "payload"]
    return frames[names].tobytes()


@pytest.mark.parametrize("vehicle", ["van_2021", "van_real"])
def test_control_takes_a_quarter_off_the_largest_roll_angle(vehicle, van_real):
    result = (
        van_real if vehicle == "van_real" else experiment.run("double_lane_change", vehicle=vehicle)
    )
    assert result.reduction >= 0.25
    assert result.helps
    assert result.limit_cycle is None
    assert not result.warnings


def test_the_same_seed_gives_the_same_frames(van_real):
    first = experiment.run("double_lane_change", duration=SHORT, seed=5)
    second = experiment.run("double_lane_change", duration=SHORT, seed=5)
    other = experiment.run("double_lane_change", duration=SHORT, seed=6)
    assert identities(first.controlled.frames) == identities(second.controlled.frames)
    assert identities(first.controlled.frames) != identities(other.controlled.frames)


def test_control_and_none_see_the_same_noise(van_real):
    """Up to the first command that is delivered, the sensors say the same."""
    for ident in (0xA0, 0xB0, 0xC8):
        first, second = (
            trace.frames[(trace.frames["ident"] == ident) & (trace.frames["t_queued"] < 150e6)]
            for trace in (van_real.passive, van_real.controlled)
        )
        assert len(first) >= 7
        assert np.array_equal(first["payload"], second["payload"])
        assert np.array_equal(first["t_queued"], second["t_queued"])


@pytest.mark.parametrize("suffix", [".blf", ".log"])
def test_logs_are_identical_byte_for_byte(van_real, tmp_path, suffix):
    first = write_log(tmp_path / f"first{suffix}", van_real.controlled.frames)
    second = write_log(tmp_path / f"second{suffix}", van_real.controlled.frames)
    assert first.read_bytes() == second.read_bytes()
    assert len(first.read_bytes()) > 10_000


def test_cantools_decodes_and_autosar_e2e_accepts_every_frame(van_real, tmp_path):
    path = write_log(tmp_path / "bus.asc", van_real.controlled.frames)
    database = cantools.database.load_file(dbc.PATH)
    contract = {message.frame_id: message for message in database.messages}
    last = {}
    count = 0
    with can.LogReader(path) as reader:
        for message in reader:
            definition = contract.get(message.arbitration_id)
            if definition is None:
                continue
            signals = definition.decode(message.data)
            data = bytearray(message.data)
            identity = dbc.data_id(definition)
            assert e2e.p01.e2e_p01_check(data, identity), (definition.name, data.hex())
            if definition.name in last:
                assert signals["Counter"] == (last[definition.name] + 1) % 15, definition.name
            last[definition.name] = int(signals["Counter"])
            count += 1
    assert count > 2000
    assert {"Imu", "AntiRollBarCommand", "ActuatorState", "RollControlStatus"} <= set(last)


def test_ages_stay_within_their_bounds(van_real, gateway):
    for result in (van_real, gateway):
        # the age starts at the sample; the bounds begin with the sensor's own delay
        sensor = sensors.delay(
            result.settings.vehicle.sensors.roll_rate, options=sensors.SensorOptions()
        )
        assert result.can.age_ms.max * 1e-3 <= result.delay.most - sensor
        assert result.can.age_ms.min * 1e-3 >= result.delay.least - sensor


def test_a_gateway_shows_its_latency_in_the_log(gateway):
    frames = gateway.controlled.frames
    imu = frames[(frames["ident"] == 0xA0) & (frames["outcome"] == DELIVERED)]
    sent, arrived = imu[imu["segment"] == 1], imu[imu["segment"] == 0]
    for first, second in itertools.islice(zip(sent, arrived, strict=False), 100):
        assert np.array_equal(first["payload"], second["payload"])
        assert second["t_queued"] - first["t_received"] == 50_000_000


def test_a_delay_beyond_the_design_is_warned_of_and_the_limit_cycle_named(gateway):
    beyond = f"the delay of {1e3 * gateway.delay.most:.0f} ms exceeds"
    assert any(line.startswith(beyond) for line in gateway.warnings)
    assert gateway.limit_cycle.frequency == pytest.approx(2.6, abs=0.4)
    assert "limit cycle" in gateway.verdict and gateway.helps is False
    assert str(gateway.limit_cycle) in gateway.warnings


def test_sensor_noise_between_two_bumps_is_no_limit_cycle():
    settings, controller = experiment.plan(
        "bumps",
        vehicle="sedan_320i",
        speed_kmh=40,
        seed=4,
        options={"height": 0.05, "length": 0.3, "spacing": 150},
        conditions={"noise": "2"},
    )
    passive, controlled = (
        experiment.drive(settings, controller, enabled=enabled) for enabled in (False, True)
    )
    found = limit_cycle.oscillations(controlled.ticks["t"], controlled.ticks["moment"])
    assert found
    roll = passive.signals
    assert experiment.limit_cycle_of(settings, controller, controlled, roll) is None


def test_a_law_that_knows_the_delay_copes_with_it():
    result = experiment.run(
        "double_lane_change", law="steering_lead", actuator="suspension", bus="gateway_50ms"
    )
    assert result.reduction > 0.35
    assert result.limit_cycle is None and not result.warnings


def test_passive_frames_go_on_and_nothing_is_delivered(van_real):
    passive = van_real.passive
    assert van_real.passive_metrics.moment_max_nm == 0
    state = passive.frames[passive.frames["ident"] == 0xD0]
    decode = dbc.load().get_message_by_name("ActuatorState").decode
    assert {decode(bytes(f["payload"][:8]))["Enabled"].value for f in state[:50]} == {0}
    assert np.sum(passive.frames["ident"] == 0x81) > 100
    assert np.all(passive.ticks["fault_codes"] == 0)


def test_the_law_passive_has_no_controlled_run():
    result = experiment.run("roundabout", law="passive", duration=SHORT)
    assert result.controlled is None
    assert result.to_json()["controlled"] is None
    assert result.helps is None


def test_the_law_passive_designs_nothing(monkeypatch):
    monkeypatch.setattr(designing, "design", None)
    settings, controller = experiment.plan("roundabout", law="passive")
    assert settings.law == "passive"
    assert not any(controller.record.output_gain)
    assert controller.tables["verification"] == {}
    assert not controller.tables["design"]["verified"]


def test_a_run_and_its_margins_list_the_failed_checks(tmp_path, capsys):
    printed = {
        "law": "hinf_delay",
        "vehicle": "van_2021",
        "gains": "as_printed",
        "unverified": True,
    }
    result = experiment.run("roundabout", **printed, duration=0.5)
    failed = result.to_json()["failed"]
    assert failed
    assert experiment.run("roundabout", law="lqr", duration=0.5).to_json()["failed"] == []
    path = tmp_path / "calibration.toml"
    calibration_file.save(path, result.record, result.tables)
    main(["margins", str(path), "--json"])
    answer = json.loads(capsys.readouterr().out)
    assert (answer["verified"], answer["failed"]) == (False, failed)


def test_a_vehicle_is_given_as_itself_as_a_file_or_by_name(tmp_path):
    preset = vehicles.load("suv_2020")
    heavier = replace(preset, plant=replace(preset.plant, sprung_mass=1100))
    result = experiment.run("roundabout", law="passive", vehicle=heavier, duration=SHORT)
    assert result.settings.vehicle == heavier
    write_files(result, tmp_path)
    assert saved_run.load(tmp_path).settings.vehicle == heavier
    file = tmp_path / "heavier.toml"
    file.write_text(tomli_w.dumps(heavier.document))
    for given in (file, str(file)):
        read = experiment.plan("roundabout", law="passive", vehicle=given)[0].vehicle
        assert (read.plant, read.file) == (heavier.plant, str(file))
    driven, controller = experiment.plan("roundabout", law="lqr", plant_vehicle=preset)
    assert (driven.vehicle, driven.plant_vehicle) == (preset, "suv_2020")
    assert controller.vehicle.name == "van_real"
    with pytest.raises(CanrollError, match=r"vehicle suv_2020: plant\.sprung_mass = -1"):
        wrong = replace(preset, plant=replace(preset.plant, sprung_mass=-1.0))
        experiment.run("roundabout", law="passive", vehicle=wrong)


def test_json_has_every_key_of_the_contract(van_real):
    text = json.dumps(van_real.to_json(), allow_nan=False)
    data = json.loads(text)
    assert {"scenario", "vehicle", "law", "bus", "seed", "passive", "controlled", "files"} <= set(
        data
    )
    metrics = {
        "roll_rms_deg", "roll_max_deg", "roll_rate_rms_deg_s", "roll_rate_max_deg_s",
        "nlt_front_max", "nlt_rear_max", "moment_rms_nm", "moment_max_nm",
    }  # fmt: skip
    assert metrics <= set(data["passive"]) and metrics <= set(data["controlled"])
    assert {"load", "frames", "response_ms", "age_ms"} <= set(data["can"])
    assert {"mean", "max"} <= set(data["can"]["response_ms"]["Imu"])
    assert {"min", "mean", "max"} == set(data["can"]["age_ms"])
    assert {"samples", "sent", "heartbeats", "transmission_rate"} <= set(data["trigger"])
    assert data["can"]["load"] == pytest.approx(0.5, abs=0.02)


def test_every_tick_sends_a_command_when_asked_to():
    result = experiment.run("double_lane_change", trigger="every", duration=SHORT)
    assert result.trigger.transmission_rate == 1


@pytest.mark.parametrize(
    ("actuator", "reduction"), [("suspension", 0.4), ("dampers", 0.1), ("valves", 0.2)]
)
def test_other_actuators_reduce_roll_too(actuator, reduction):
    """Dampers only resist their stroke: they cannot hold a roll angle."""
    result = experiment.run("double_lane_change", actuator=actuator)
    assert result.reduction > reduction


def test_a_bus_with_another_delay_than_designed_for_is_named(tmp_path):
    designed = prepared.prepare({"law": "lqr", "bus": "gateway_20ms"})
    path = tmp_path / "calibration.toml"
    calibration_file.save(path, designed.record, designed.tables)
    for bus, warned in (("gateway_20ms", False), (None, True), ("500k", True)):
        loaded = prepared.prepare({"calibration": path, "bus": bus})
        text = " ".join(loaded.warnings)
        assert ("is designed for 16 to 50.2 ms from sample to force, bus 500k" in text) == warned


def test_a_calibration_file_gives_the_same_run(tmp_path, capsys):
    options = ["double_lane_change", "--duration", str(SHORT), "--json"]
    assert main(["run", *options, "--law", "lqr", "--out", str(tmp_path)]) == 0
    first = json.loads(capsys.readouterr().out)
    calibration = first["files"]["calibration"]
    assert main(["run", *options, "--calibration", calibration]) == 0
    second = json.loads(capsys.readouterr().out)
    assert first["controlled"] == second["controlled"]
    assert first["calibration_id"] == second["calibration_id"]
    assert second["files"] == {}


@pytest.mark.parametrize(
    "bus",
    [
        {},
        {"actuator": "suspension", "dbc": f"{OWN_BUS}.dbc", "map": f"{OWN_BUS}.toml"},
        {"bus": "secured_fd"},
    ],
    ids=["built in", "own frames", "authenticated"],
)
def test_python_and_native_code_give_the_same_frames(bus):
    settings, controller = experiment.plan("double_lane_change", **bus)
    python, native = (
        experiment.drive(replace(settings, backend=name), controller, enabled=True, duration=SHORT)
        for name in ("python", "native")
    )
    assert len(python.ages) > 10
    assert identities(python.frames) == identities(native.frames)
    assert np.array_equal(python.ticks, native.ticks)


def test_an_equal_task_is_designed_once(monkeypatch, tmp_path):
    tasks = []
    original = designing.design
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(
        designing, "design", lambda law, task: tasks.append(task) or original(law, task)
    )
    same = [experiment.plan("double_lane_change", law="lqr", speed_kmh=v)[1] for v in (70, 80)]
    other = experiment.plan("double_lane_change", law="lqr", bus="125k_busy")[1]
    assert len(tasks) == 2
    assert same[0].record.id == same[1].record.id
    assert other.tables["design"]["delay_max_s"] != same[0].tables["design"]["delay_max_s"]


def test_what_is_done_to_a_calibration_is_not_in_the_next():
    seen = set()
    for _ in range(3):
        _, controller = experiment.plan("double_lane_change", law="lqr")
        seen.add((controller.record.crc, controller.tables["design"]["verified"]))
        controller.record.crc ^= 1
        controller.tables["design"]["verified"] = "spoilt"
    assert len(seen) == 1


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"speed_kmh": 800.0}, "speed 800 km/h: the speed of the .* must be "),
        ({"options": {"shift": 1.0}}, "unknown option of moose 'shift'"),
    ],
)
def test_wrong_input_is_refused_before_anything_is_designed(given, message, monkeypatch):
    monkeypatch.setattr(experiment, "prepare", lambda _: pytest.fail("designed"))
    with pytest.raises(CanrollError, match=message):
        experiment.plan("moose", **given)


def test_options_of_the_manoeuvre_reach_it():
    grip = experiment.run("moose", plant="nonlinear", law="passive")
    ice = experiment.run("moose", plant="nonlinear", law="passive", options={"friction": "0.3"})
    most = [np.max(np.abs(r.passive.signals["ay"])) for r in (grip, ice)]
    assert most[1] < 0.3 * 9.81 * 1.1 < most[0]


def test_files_of_a_run(tmp_path, capsys):
    assert main(["run", "double_lane_change", "--duration", "1.5", "--out", str(tmp_path)]) == 0
    text = capsys.readouterr().out
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {
        "report.html", "bus.asc", "canroll_gains.h", "calibration.toml", "trace.npz",
        "result.json",
    }  # fmt: skip
    assert all(name in text for name in names)
    assert json.loads((tmp_path / "result.json").read_text())["files"]["report"].endswith(".html")


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["nosuch"], "unknown scenario 'nosuch'"),
        (["double_lane_change", "--speed", "-5"], "speed -5 km/h"),
        (["double_lane_change", "--speed", "nan"], "speed nan km/h"),
        (["double_lane_change", "--duration", "0"], "duration 0 s"),
        (["double_lane_change", "--vehicle", "vna_2021"], "did you mean 'van_2021'?"),
        (["double_lane_change", "--vehicle", ""], "--vehicle must not be empty"),
        (["double_lane_change", "--set", "friction"], "key=value"),
        (["double_lane_change", "--set", "fricton=0.5"], "did you mean 'friction'?"),
        (["double_lane_change", "--seed", "x"], "--seed"),
        (["double_lane_change", "--log", "bus.txt"], ".asc, .blf, .log"),
        (["double_lane_change", "--log", "nowhere/x.asc"], "no such folder nowhere"),
        (["double_lane_change", "--signals", "x.txt"], ".csv, .mf4"),
        (["double_lane_change", "--signals", "nowhere/x.csv"], "no such folder nowhere"),
        (["double_lane_change", "--out", ""], "--out: must not be empty"),
        (["double_lane_change", "--heartbeat", "200"], "--heartbeat 200"),
        (["double_lane_change", "--out", "/proc/nowhere"], "cannot write to /proc/nowhere"),
        (["double_lane_change", "--calibration", "none.toml"], "none.toml"),
        ([], "scenario"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_in_one_line(options, expected, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["run", *options]) == 2
    error = capsys.readouterr().err
    assert error.startswith("canroll: ") and error.count("\n") == 1
    assert expected in error
    assert {path.name for path in tmp_path.rglob("*")} <= {"out"}


def test_interrupted_runs_leave_a_complete_log(tmp_path, monkeypatch, capsys):
    class Interrupting(PythonEcu):
        def tick(self, elapsed_ticks=1):
            if self.state.time == 100:
                raise KeyboardInterrupt
            return super().tick(elapsed_ticks)

    monkeypatch.setattr(
        experiment, "open_backend", lambda name, record, firmware, key: Interrupting(record)
    )
    log = tmp_path / "bus.blf"
    assert main(["run", "double_lane_change", "--json", "--log", str(log)]) == 130
    with can.LogReader(log) as reader:
        times = [message.timestamp for message in reader]
    assert max(times) == pytest.approx(1.0, abs=0.05)
    assert len(times) > 1000
    assert capsys.readouterr().out == ""


def test_a_misspelt_choice_is_named_and_not_ignored():
    with pytest.raises(UnknownNameError, match="did you mean 'law'"):
        experiment.plan("double_lane_change", lawn="lqr")


def test_a_run_is_driven_again_from_its_own_log(tmp_path, capsys):
    """By the signals of the network description, of which the log is all that is left."""
    file = tmp_path / "drive.csv"
    file.write_text("time,steering_wheel_deg,speed_kmh\n0,0,72\n0.5,0,72\n0.8,60,72\n2,60,60\n")
    first = experiment.run("from_file", law="passive", options={"file": str(file)})
    assert first.to_json()["speed_kmh"] == pytest.approx(72.0)
    log = {
        "file": str(write_log(tmp_path / "bus.blf", first.passive.frames)),
        "dbc": str(dbc.PATH),
        "column": "SteeringWheelAngle",
        "speed_column": "VehicleSpeed",
    }
    again = experiment.run("from_file", law="passive", options=log)
    most = first.passive_metrics.roll_max_deg
    assert most > 1.0
    assert again.passive_metrics.roll_max_deg == pytest.approx(most, rel=0.03)
    vx = [result.passive.signals["vx"][-1] for result in (first, again)]
    assert vx[0] == pytest.approx(vx[1], rel=0.01)
    assert 3.6 * vx[0] == pytest.approx(60.0, abs=1.3)

    assert main(["run", "from_file", "--set", f"file={file}", "--speed", "60"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith("has a speed over time, 72 km/h at its start: omit --speed")


def test_what_a_file_leaves_out_is_a_warning(tmp_path):
    text = dbc.PATH.read_text(encoding="latin-1")
    own = tmp_path / "own.dbc"
    own.write_text(text + '\nVAL_ 176 SteeringWheelAngle 0 "Centre" ;\n', encoding="latin-1")
    frames = experiment.run("step_steer", law="passive", duration=1.5).passive.frames
    log = {
        "file": str(write_log(tmp_path / "bus.blf", frames)),
        "dbc": str(own),
        "column": "SteeringWheelAngle",
    }
    result = experiment.run("from_file", law="passive", options=log)
    assert any("have no number of it: left out" in warning for warning in result.warnings)
