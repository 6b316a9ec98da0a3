"""A recorded drive through the firmware: the run's own log, a foreign car's, and none of ours."""

import json
from pathlib import Path

import can
import numpy as np
import pytest
from support import rough_bus

from canroll.cli import ecu
from canroll.cli.main import parse
from canroll.codegen.generated.mailbox import EXTENDED
from canroll.errors import CanrollError, VerdictError
from canroll.firmware.state import RX_IMU
from canroll.gain_gen.calibration import calibration_file
from canroll.runs import experiment, logs
from canroll.setup.bus_frames import firmware_of, profile_of

FOREIGN = Path(__file__).parents[3] / "examples" / "own_bus"
SILENT = 2.0


@pytest.fixture(
    scope="module",
    params=[
        lambda _: {},
        lambda _: {"dbc": str(FOREIGN / "own.dbc"), "map": str(FOREIGN / "own.toml")},
        pytest.param(
            lambda folder: dict(
                zip(("dbc", "map"), map(str, rough_bus.write(folder)), strict=True)
            ),
            marks=pytest.mark.slow,
        ),
    ],
    ids=["own frames", "foreign DBC", "defective DBC"],
)
def recorded(request, tmp_path_factory):
    """A run's trace, its log, and the command line that replays it; the IMU's identifier."""
    bus = request.param(tmp_path_factory.mktemp("bus"))
    settings, controller = experiment.plan(
        "double_lane_change", actuator="suspension", duration=4.0, **bus
    )
    trace = experiment.simulate(settings, controller).controlled
    folder = tmp_path_factory.mktemp("drive")
    log = logs.write_log(folder / "drive.mf4", trace.frames)
    calibration = folder / "calibration.toml"
    calibration_file.save(calibration, controller.record, controller.tables)
    options = [word for name, file in bus.items() for word in (f"--{name}", file)]
    imu = firmware_of(profile_of(bus), None).bus.received[RX_IMU].ident
    return trace, log, ["ecu", "--calibration", str(calibration), *options, "--replay"], imu


def candump(message, data=None, *, by_s=0.0):
    """A line of a log, with other data or another time."""
    ident = f"{message.arbitration_id:0{8 if message.is_extended_id else 3}X}"
    data = message.data if data is None else data
    return f"({message.timestamp + by_s:.6f}) can0 {ident}#{data.hex()}\n"


def replayed(line, log, folder, capsys):
    assert ecu.run(parse([*line, str(log), "--out", str(folder), "--json"])) == 0
    return json.loads(capsys.readouterr().out)


@pytest.mark.slow
def test_the_recorded_drive_is_seen_as_in_the_run(recorded, tmp_path, capsys):
    trace, log, line, _ = recorded
    found = replayed(line, log, tmp_path, capsys)
    ticks = trace.ticks
    most = np.degrees(np.abs(ticks["roll"]).max())
    assert found["estimated_roll_max_deg"] == pytest.approx(most, rel=0.03)
    assert found["moment_max_nm"] == pytest.approx(np.abs(ticks["moment"]).max(), rel=0.05)
    assert found["ticks"] == pytest.approx(len(ticks), abs=3)
    assert found["mode_shares"]["ACTIVE"] > 0.9
    assert all(heard["frames"] > 0 for heard in found["receptions"])
    page = (tmp_path / "drive.html").read_text(encoding="utf-8")
    assert "have no effect on the drive" in page
    assert "Commands that would have been sent" in page
    assert json.loads((tmp_path / "drive.json").read_text())["commands"] == found["commands"] > 50


def test_a_sensor_silent_in_the_recording_is_reported(recorded, tmp_path, capsys):
    _, log, line, imu = recorded
    cut = tmp_path / "cut.asc"
    with can.LogReader(log) as reader, can.Logger(cut) as writer:
        for message in reader:
            ident = message.arbitration_id | (EXTENDED if message.is_extended_id else 0)
            if message.timestamp < SILENT or ident != imu:
                writer.on_message_received(message)
    found = replayed(line, cut, tmp_path, capsys)
    first = min(seen["first"] for seen in found["codes"])
    assert SILENT < first < SILENT + 0.3
    assert found["modes"][-1]["mode"] == "SAFE"
    assert found["receptions"][0]["frames"] < 0.6 * found["receptions"][1]["frames"]


def test_what_is_wrong_with_a_frame_is_named(recorded, tmp_path, capsys):
    """The n-th Imu frame is damaged as its place says; the others are as recorded."""
    _, log, line, imu = recorded
    damaged = tmp_path / "damaged.log"
    damage = {
        50: lambda data: data[:-1],
        51: lambda data: bytes([data[0] ^ 0x40]) + data[1:],
        52: lambda data: data[:3] + bytes([data[3] ^ 1]) + data[4:],
        # the counter stands still
        90: lambda data: None,
    }
    count, before = 0, b""
    with can.LogReader(log) as reader, damaged.open("w", encoding="utf-8") as file:
        for m in reader:
            data = bytes(m.data)
            if m.arbitration_id | (EXTENDED if m.is_extended_id else 0) == imu:
                count += 1
                original, data = data, damage.get(count, lambda data: data)(data) or before
                before = original
                if 200 <= count < 240:
                    continue
            file.write(candump(m, data))
    found = replayed(line, damaged, tmp_path, capsys)
    heard = found["receptions"][0]
    assert (heard["length"], heard["late"], heard["not_authentic"]) == (1, 1, 0)
    if heard["profile"]:
        assert (heard["checksum"], heard["counter"]) == (2, 1)
    accounted = ("accepted", "replaced", "synchronising", "length", "checksum", "counter")
    assert sum(heard[key] for key in accounted) == pytest.approx(heard["frames"], abs=1)
    assert heard["accepted"] > heard["frames"] - 15
    for other in found["receptions"][1:]:
        assert not any(other[key] for key in ("length", "checksum", "counter"))
    page = (tmp_path / "drive.html").read_text(encoding="utf-8")
    assert f"{heard['message']}: 1 by length" in page


def test_a_wrong_data_id_is_named(recorded, tmp_path, capsys):
    """Every frame fails: an end-to-end setting that is not the sender's."""
    _, log, line, imu = recorded
    damaged = tmp_path / "damaged.log"
    with can.LogReader(log) as reader, damaged.open("w", encoding="utf-8") as file:
        for m in reader:
            data = bytes(m.data)
            if m.arbitration_id | (EXTENDED if m.is_extended_id else 0) == imu:
                data = bytes([data[0] ^ 0x40]) + data[1:]
            file.write(candump(m, data))
    verdict = ""
    try:
        replayed(line, damaged, tmp_path, capsys)
    except VerdictError as error:
        verdict = str(error)
    heard = json.loads((tmp_path / "drive.json").read_text())["receptions"][0]
    count, profile = heard["frames"], heard["profile"]
    if not profile:
        assert not verdict
        return
    assert heard["checksum"] == count
    assert verdict == (
        f"{heard['message']}: {count} of {count} frames fail their checksum (profile {profile}): "
        f"{'constant' if profile == 'own' else 'data_id'}?"
    )
    assert verdict in (tmp_path / "drive.html").read_text(encoding="utf-8")


def test_another_bus_and_options_of_a_bus_are_refused(recorded, tmp_path):
    _, log, line, _ = recorded
    other = tmp_path / "other.asc"
    with can.Logger(other) as writer:
        for k in range(100):
            writer.on_message_received(
                can.Message(timestamp=0.01 * k, arbitration_id=0x7A0, is_extended_id=False)
            )
    with pytest.raises(CanrollError, match="none of the frames that the ECU receives"):
        ecu.run(parse([*line, str(other), "--out", str(tmp_path)]))
    for option in (("--duration", "3"), ("-i", "virtual"), ("--trace", "t.npz"), ("--cpu", "0")):
        with pytest.raises(CanrollError, match="a recorded drive has no bus: omit it"):
            ecu.run(parse([*line, str(log), *option]))
    for option in (("--json",), ("--section", "1")):
        with pytest.raises(CanrollError, match=f"{option[0]}: it belongs to --replay of a bus log"):
            ecu.run(parse([*line[:-1], *option]))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("by_s", "remark"),
    [(259_200.0, "the times step forward by 3 d at frame"), (-1.5, "the times step back by 1.")],
)
def test_a_log_whose_times_step_is_replayed_in_sections(recorded, tmp_path, capsys, by_s, remark):
    _, log, line, _ = recorded
    cut = tmp_path / "cut.log"
    with can.LogReader(log) as reader:
        messages = list(reader)
    with cut.open("w", encoding="utf-8") as file:
        for m in messages:
            later = 1000.0 + (by_s if m.timestamp >= SILENT else 0.0)
            file.write(candump(m, by_s=later))
        file.write(f"({m.timestamp + later:.6f}) can0 20000088#0000000000000000\n")
    rest = messages[-1].timestamp - SILENT
    for section, length in (((), max(SILENT, rest)), ((1,), SILENT), ((2,), rest)):
        options = [word for number in section for word in ("--section", str(number))]
        found = replayed([*line[:-1], *options, "--replay"], cut, tmp_path, capsys)
        assert found["seconds"] == pytest.approx(length, abs=0.03)
        assert remark in found["remarks"][0]
    assert found["error_frames"] == 1
    assert "error frames in the log: 1" in (tmp_path / "drive.html").read_text(encoding="utf-8")
    with pytest.raises(CanrollError, match="--section 3: there are sections 1 to 2"):
        ecu.run(parse([*line[:-1], "--section", "3", "--replay", str(cut)]))
