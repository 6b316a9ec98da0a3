"""Signals and messages whose names have a meaning in C: the bundle gives them others."""

import subprocess
from pathlib import Path

import pytest

from canroll.codegen.export import cantools_codec
from canroll.codegen.generated import bus_map
from canroll.codegen.run import native
from canroll.codegen.run.bus_firmware import of_bus
from canroll.errors import CanrollError

DBC = """VERSION ""
BU_: X
BO_ 100 while: 8 X
 SG_ int : 0|16@1- (0.01,0) [0|0] "deg/s" X
 SG_ LAT_T : 16|16@1- (0.01,0) [0|0] "m/s2" X
 SG_ Lat_T_ : 32|8@1- (0.01,0) [0|0] "deg/s" X
 SG_ T : 40|8@1- (0.01,0) [0|0] "deg/s" X
BO_ 101 Mux: 8 X
 SG_ static M : 0|8@1+ (1,0) [0|0] "" X
 SG_ class m1 : 8|8@1+ (1,0) [0|0] "" X
 SG_ CLASS m2 : 8|8@1+ (1,0) [0|0] "" X
 SG_ class_ m3 : 8|8@1+ (1,0) [0|0] "" X
BO_ 102 mux: 8 X
 SG_ uint8_t : 0|8@1+ (1,0) [0|0] "" X
"""
MAP = """schema = 1
[receive.imu]
message = "while"
signals.int = "roll_rate"
signals.LAT_T = "lateral_acceleration"
signals.T = "yaw_rate"
"""


@pytest.fixture
def paths(tmp_path):
    (tmp_path / "car.dbc").write_text(DBC)
    (tmp_path / "car.toml").write_text(MAP)
    return tmp_path / "car.dbc", tmp_path / "car.toml"


def test_the_loop_reads_signals_of_any_name(paths):
    source = of_bus(*paths).files["canroll_signals.c"]
    assert "raw_int" in source and "raw_t_" in source and "raw_lat_t_" in source


def test_signals_of_one_name_in_the_code_are_refused_by_their_names(paths):
    paths[1].write_text(MAP.replace("signals.T ", "signals.Lat_T_ "))
    with pytest.raises(CanrollError, match=r"car\.toml \[receive\.imu\]: LAT_T and Lat_T_ are one"):
        bus_map.load(*paths)


@pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler")
@pytest.mark.parametrize(("compiler", "kind"), [("cc", "c"), ("c++", "h")])
def test_the_codec_of_cantools_compiles_in_c_and_cpp(paths, tmp_path, compiler, kind):
    for name, text in cantools_codec.files(paths[0]).items():
        (tmp_path / name).write_text(text)
    language = ["-x", "c++"] if kind == "h" else ["-std=c99"]
    source = tmp_path / f"canroll_codec.{kind}"
    command = [compiler, *language, "-c", str(source), "-o", str(tmp_path / "codec.o")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stderr


def test_nothing_is_renamed_without_need():
    plain = Path(__file__).parents[3] / "dbc" / "roll_control.dbc"
    database = cantools_codec.read(plain)[0]
    names = [[s.name for s in m.signals] for m in database.messages]
    copy = cantools_codec.named(database)
    assert [[s.name for s in m.signals] for m in copy.messages] == names
    assert [m.name for m in copy.messages] == [m.name for m in database.messages]


def test_no_message_names_a_file_that_is_gone(paths, monkeypatch):
    """A name that the subset refuses, had it got there."""
    monkeypatch.setattr(
        "canroll.codegen.generated.signal_code.local_name", lambda name: f"raw_{name}_t"
    )
    monkeypatch.setattr("canroll.codegen.generated.mailbox.local_name", lambda name: name)
    with pytest.raises(CanrollError) as refused:
        _ = of_bus(*paths).files
    assert str(refused.value).startswith("firmware/com/signals.py:")
