"""A run on a network that several files describe is that on the one file of all their messages."""

import json
from dataclasses import asdict

import numpy as np
import pytest
from support import split_bus

from canroll.cli.main import main
from canroll.cli.run import about
from canroll.errors import CanrollError
from canroll.plant_sim.can_bus import load_profile
from canroll.report.run_folder import write_files
from canroll.report.signal_files import write_signals
from canroll.runs import experiment, saved_run
from canroll.runs.result import Run
from canroll.setup.bus_frames import check_frames

SHORT = {"actuator": "suspension", "duration": 1.0}


def chosen(files):
    return {"dbc": list(map(str, files)), "map": str(split_bus.MAP)}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return split_bus.write(tmp_path_factory.mktemp("split"))


@pytest.fixture(scope="module")
def both(files):
    return experiment.run("double_lane_change", **SHORT, **chosen(files))


@pytest.mark.slow
def test_a_run_on_two_files_is_that_on_one(both):
    one = experiment.run("double_lane_change", **SHORT, **chosen([split_bus.OWN]))
    assert one.settings.dbc == str(split_bus.OWN)
    assert asdict(both.controlled_metrics) == asdict(one.controlled_metrics)
    np.testing.assert_array_equal(both.controlled.frames[:], one.controlled.frames[:])
    assert both.warnings == one.warnings


@pytest.mark.slow
def test_a_saved_run_knows_all_its_files(both, files, tmp_path):
    write_files(both, tmp_path)
    assert json.loads((tmp_path / "result.json").read_text())["dbc"] == list(map(str, files))
    again = saved_run.load(tmp_path)
    assert again.settings == both.settings and again.can == both.can
    assert again.settings.bus_name == "500k, frames of car.dbc and actuators.dbc"


@pytest.mark.parametrize("saved", ["own.dbc", None, ["car.dbc", "own.dbc"]])
def test_settings_are_read_as_they_were_written(both, saved):
    data = both.settings.choices() | {"dbc": saved}
    others = {
        name: getattr(both.settings, name)
        for name in ("scenario", "vehicle", "command", "phase", "stage")
    }
    settings = Run.of(data, **others)
    assert settings.dbc == (tuple(saved) if isinstance(saved, list) else saved)
    assert settings.choices()["dbc"] == saved


def test_the_signals_of_a_run_carry_all_descriptions(both, files, tmp_path):
    reader = pytest.importorskip("mcap.reader", reason="needs mcap")
    trace = both.controlled
    path = write_signals(tmp_path / "run.mcap", trace.signals, about(both, trace))
    with path.open("rb") as file:
        attached = [(a.name, a.data) for a in reader.make_reader(file).iter_attachments()]
    assert attached == [(each.name, each.read_bytes()) for each in files]


def network_of(files, descriptions, name):
    path = files[0].with_name(name)
    text = f'schema = 1\nbitrate = 500000\nmap = "{split_bus.MAP}"\ndbc = {descriptions}\n'
    path.write_text(text, encoding="utf-8")
    return load_profile(str(path))


def test_a_network_file_names_several(files):
    assert network_of(files, '["car.dbc", "actuators.dbc"]', "net.toml").dbc == files
    with pytest.raises(CanrollError, match="must be a text or a list of texts"):
        network_of(files, '["car.dbc", 3]', "wrong.toml")
    with pytest.raises(CanrollError, match=r"dbc = 'other\.dbc': no such file"):
        network_of(files, '["car.dbc", "other.dbc"]', "missing.toml")


def test_another_bit_rate_is_told_with_its_file(both, tmp_path):
    files = split_bus.write(tmp_path)
    text = files[1].read_text(encoding="utf-8")
    rate = 'BA_DEF_ "Baudrate" INT 0 1000000;\nBA_DEF_DEF_ "Baudrate" 0;\nBA_ "Baudrate" 250000;\n'
    files[1].write_text(text + "\n" + rate, encoding="utf-8")
    warnings = check_frames(load_profile("500k", files, split_bus.MAP), both.record)
    assert f"{files[1]}: its Baudrate is 250000 bit/s, that of bus 500k 500000" in warnings


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ([], "--dbc must not be empty"),
        (["none.dbc", str(split_bus.OWN)], "none.dbc: no such file"),
        ([str(split_bus.OWN)] * 2, "own.dbc: given twice"),
    ],
)
def test_what_cannot_be_one_description_is_refused(given, says):
    with pytest.raises(CanrollError, match=says):
        experiment.run("double_lane_change", **SHORT, dbc=given, map=str(split_bus.MAP))


def test_a_message_of_two_files_is_one_line_on_the_command_line(files, capsys):
    options = ["--dbc", str(files[0]), "--dbc", str(split_bus.OWN), "--map", str(split_bus.MAP)]
    assert main(["run", "double_lane_change", *options]) == 2
    error = capsys.readouterr().err
    assert f"GYRO_01 is in {files[0]} and {split_bus.OWN}" in error and error.count("\n") == 1
