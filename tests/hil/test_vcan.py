"""Runs on a real vcan0, in lock step, with candump as the witness of every frame."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import can
import numpy as np
import pytest
from e2e import p01

from canroll import dbc
from canroll.cli.main import main
from canroll.hil import lockstep, tick_trace
from canroll.hil.bus_link import EXTENDED

ROOT = Path(__file__).parents[2]
VCAN_VM = ROOT / "scripts" / "vcan-vm"

pytestmark = pytest.mark.long


def on_vcan(script, folder):
    """Run a shell script where vcan0 is: here, or in the guest; ``folder`` is shared with it."""
    here = Path("/sys/class/net/vcan0").exists()
    if not here and (shutil.which("apt-get") is None or os.uname().machine != "x86_64"):
        pytest.skip("no vcan0, and scripts/vcan-vm needs Debian on x86_64")
    command = ["bash", "-euc", script]
    environment = {
        **os.environ,
        "VCAN_VM_RW": str(folder),
        "VCAN_VM_TIMEOUT": "1700",
        "PYTHON": sys.executable,
    }
    return subprocess.run(
        command if here else [VCAN_VM, *command],
        env=environment,
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=1800,
        check=False,
    )


@pytest.fixture(scope="module")
def witnessed(tmp_path_factory):
    """Three seconds of the lane change on vcan0, twice: answers, folder, candump's log of one.

    The machine may be as slow as it likes.
    """
    if shutil.which("candump") is None:
        pytest.skip("needs can-utils: apt-get install can-utils")
    folder = tmp_path_factory.mktemp("vcan")
    script = f"""
        cd {folder}
        run="hil double_lane_change --duration 3 --pace lockstep -i socketcan -c vcan0 --json"
        candump -r 4194304 -L vcan0 >dump.log & witness=$!
        "$PYTHON" -m canroll.cli.main $run --out out >first.json
        sleep 0.5
        kill $witness
        "$PYTHON" -m canroll.cli.main $run --out again >second.json
    """
    ran = on_vcan(script, folder)
    assert ran.returncode == 0, ran.stderr
    return [
        json.loads((folder / f"{name}.json").read_text()) for name in ("first", "second")
    ], folder


def test_lock_step_on_vcan_is_virtual_time(witnessed, tmp_path, capsys):
    answers, folder = witnessed
    words = ["run", "double_lane_change", "--duration", "3", "--json", "--out", str(tmp_path)]
    assert main(words) == 0
    virtual = json.loads(capsys.readouterr().out)
    for answer in answers:
        assert answer["timing"]["valid"]
        assert answer["verdict"] == virtual["verdict"]
    for out in ("out", "again"):
        ours, theirs = np.load(folder / out / "trace.npz"), np.load(tmp_path / "trace.npz")
        with ours, theirs:
            for name in ours.files:
                assert ours[name].tobytes() == theirs[name].tobytes(), (out, name)


def test_candump_saw_what_the_firmware_sent_and_cantools_understands_it(witnessed):
    _, folder = witnessed
    database = dbc.load()
    with can.CanutilsLogReader(folder / "dump.log") as log:
        messages = list(log)
    grants = {m.arbitration_id for m in messages if m.is_extended_id}
    assert grants == {ident & ~EXTENDED for ident in (lockstep.GRANT, lockstep.ACKNOWLEDGEMENT)}
    seen = [(m.arbitration_id, bytes(m.data)) for m in messages if not m.is_extended_id]
    assert {ident for ident, _ in seen} == {0x81, 0xA0, 0xB0, 0xC0, 0xC8, 0xD0, 0xD8, 0x300, 0x301}
    for ident, payload in seen:
        message = database.get_message_by_frame_id(ident)
        message.decode(payload)
        assert p01.e2e_p01_check(bytearray(payload), dbc.data_id(message))
    trace = tick_trace.load(folder / "out" / "ticks.npz")
    sent = trace.frames[trace.frames["sent"] == 1]
    theirs = [(int(f["ident"]), bytes(f["payload"][: f["length"]])) for f in sent]
    ours = [frame for frame in seen if frame[0] in (0x81, 0x300, 0x301)]
    # after the last tick comes the command of nothing
    assert ours[:-1] == theirs
    last = database.decode_message(*ours[-1])
    assert str(last["Mode"]) == "SAFE"
    commands = [database.decode_message(*frame) for frame in ours[:-1] if frame[0] == 0x81]
    assert np.ptp([command["TorqueFront"] for command in commands]) > 500


def test_the_guest_passes_on_streams_and_exit_code(tmp_path):
    """What is a pipe here is no terminal there, so that no progress gets into a log."""
    python = "import sys; print(sys.stdout.isatty(), sys.stderr.isatty()); sys.exit('gone')"
    ran = on_vcan(f'"$PYTHON" -c "{python}"', tmp_path)
    assert (ran.returncode, ran.stdout, ran.stderr) == (1, "False False\n", "gone\n")


def test_a_missing_interface_is_one_line(tmp_path, calibration_file):
    script = f"""
        cd {tmp_path}
        "$PYTHON" -m canroll.cli.main ecu -i socketcan -c vcan7 --calibration {calibration_file}
    """
    ran = on_vcan(script, tmp_path)
    assert ran.returncode == 2
    assert ran.stderr.count("\n") == 1
    assert "sudo ip link add dev vcan7 type vcan" in ran.stderr


@pytest.mark.long
def test_a_run_in_real_time_on_vcan_says_what_it_was(tmp_path):
    """On a guest that may be far too slow: a verdict and 0, or none and 1."""
    script = f"""
        cd {tmp_path}
        "$PYTHON" -m canroll.cli.main hil double_lane_change --law lqr -i socketcan -c vcan0 \\
            --json >answer.json && echo 0 >code || echo $? >code
    """
    ran = on_vcan(script, tmp_path)
    assert ran.returncode == 0, ran.stderr
    code = int((tmp_path / "code").read_text())
    assert code in (0, 1), ran.stderr
    text = (tmp_path / "answer.json").read_text()
    if not text:
        # a side was so late that the other one gave it up
        assert (code, "not valid" in ran.stderr) == (1, True)
        return
    answer = json.loads(text)
    assert answer["timing"]["compilations"] == 0
    assert (code == 0) == answer["timing"]["valid"] == (answer["helps"] is not None)


@pytest.mark.long
def test_a_killed_ecu_is_replaced_on_vcan(tmp_path, calibration_file):
    """The bus outlives it, and in lock step time stands still until the next one is there."""
    script = f"""
        cd {tmp_path}
        bus="-i socketcan -c vcan0 --peer-timeout 0 --pace lockstep"
        canroll="$PYTHON -m canroll.cli.main"
        waits() {{ for _ in $(seq 9000); do grep -q "$1" "$2" && return; sleep 0.1; done; exit 9; }}
        $canroll plant double_lane_change --duration 3 $bus --wait 0 >plant & plant=$!
        waits "plant waits" plant
        $canroll ecu $bus --calibration {calibration_file} --duration 1 >ecu1
        $canroll ecu $bus --calibration {calibration_file} --trace ticks.npz >ecu2 & ecu=$!
        wait $plant
        kill $ecu
        wait $ecu
    """
    ran = on_vcan(script, tmp_path)
    said = [path.read_text() for path in sorted(tmp_path.glob("[pe]*")) if path.is_file()]
    assert ran.returncode == 0, (ran.stderr, said)
    trace = tick_trace.load(tmp_path / "ticks.npz")
    assert trace.ticks["number"].tolist() == list(range(101, 301))
    modes = tick_trace.replay(trace, "python").rows["mode"]
    changes = modes[np.flatnonzero(np.diff(modes, prepend=255))]
    assert list(changes[:2]) == [0, 1]
