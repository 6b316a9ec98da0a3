"""Tables of SavvyCAN and python-can, and traces of PEAK's tools in all versions."""

import numpy as np
import pytest

from canroll.errors import CanrollError
from canroll.plant_sim.can_bus.traffic.log_reader import read_log
from canroll.plant_sim.can_bus.wire.frame import BIT_RATE_SWITCH, EXTENDED, FD, REMOTE

SAVVYCAN = "Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8\n"
ROWS = range(20)


def read(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return read_log(path)


@pytest.mark.parametrize("direction", ["Rx,", ""])
def test_a_table_of_savvycan(tmp_path, direction):
    head = SAVVYCAN if direction else SAVVYCAN.replace("Dir,", "")
    rows = "".join(
        f"{166064000 + 10_000 * k},0000021A,false,{direction}1,3,FE,36,{k:02X},\n" for k in ROWS
    )
    last = f"{166064000 + 300_000},18FF0001,true,{direction}1,0,\n"
    logged = read(tmp_path, "log.csv", head + rows + last)["1"]
    assert logged.ident.tolist() == [0x21A] * 20 + [0x18FF0001]
    assert logged.flags.tolist() == [0] * 20 + [EXTENDED]
    assert set(np.diff(logged.received_ns[:20])) == {10_000_000}
    assert logged.payload[7, :3].tolist() == [0xFE, 0x36, 7]


def test_a_row_of_savvycan_that_cannot_be_read_or_be(tmp_path):
    good = "166064000,0000021A,false,Rx,0,2,FE,36,\n"
    with pytest.raises(CanrollError, match="line 3: not a row of these columns: '166,zz,f"):
        read(tmp_path, "log.csv", f"{SAVVYCAN}{good}166,zz,false,Rx,0,2,FE,36,\n")
    short = read(tmp_path, "log.csv", f"{SAVVYCAN}{good}{good.replace(',2,', ',4,')}")["0"]
    assert short.remarks == ("line 3: 2 of 4 bytes: left out",)


@pytest.mark.parametrize("text", ["time;id;bytes\n0.1;123;00 11\n", "nonsense\n"])
def test_a_table_with_other_columns_names_those_expected(tmp_path, text):
    words = r"columns '.*': expected are timestamp,arbitration_id,.* or Time Stamp,ID,Extended"
    with pytest.raises(CanrollError, match=words):
        read(tmp_path, "log.csv", text)


def test_a_table_of_python_can_with_fd_frames_and_a_bad_row(tmp_path):
    head = "timestamp,arbitration_id,extended,remote,error,dlc,data\n"
    text = f"{head}0.1,0x80,0,0,0,1,AA==\n0.2,0x80,0,0,0,12,AAAAAAAAAAAAAAAA\n"
    logged = read(tmp_path, "log.csv", text)["None"]
    assert logged.length.tolist() == [1, 12]
    assert logged.flags.tolist() == [0, FD]
    with pytest.raises(CanrollError, match=r"line 4: not a row of these columns: '0\.3,0x80'"):
        read(tmp_path, "log.csv", f"{text}0.3,0x80\n")


START = ";$STARTTIME=43008.920986006946\n"
VERSIONS = {
    "1.0": (";\n", "{n:6}) {ms:9} 0290 8 11 22 33 44 55 66 77 {n:02X}"),
    "1.1": (START, "{n:6}) {ms:9}.3  Rx 0290  8  11 22 33 44 55 66 77 {n:02X}"),
    "1.2": (START, "{n:6}) {ms:9}.300 1 Rx 0290 8  11 22 33 44 55 66 77 {n:02X}"),
    "1.3": (START, "{n:6}) {ms:9}.300 1 Rx 0290 -  8    11 22 33 44 55 66 77 {n:02X}"),
    "2.0": (
        f"{START};$COLUMNS=N,O,T,I,d,l,D\n",
        "{n} {ms}.3 DT 0290 Rx 8 11 22 33 44 55 66 77 {n:02X}",
    ),
    "2.1": (
        f"{START};$COLUMNS=N,O,T,B,I,d,R,L,D\n",
        "{n} {ms}.3 DT 1 0290 Rx - 8 11 22 33 44 55 66 77 {n:02X}",
    ),
}
ERRORS = {
    "1.1": (
        "   21)  200.3  Error     0008  4  00 19 08 08",
        "22) 201.3 Warng FFFFFFFF 4 00 00 00 08",
    ),
    "1.3": (
        "21) 200.300 1 Error 0008 - 4 00 19 08 08",
        "22) 201.3 1 Warng FFFFFFFF - 4 00 00 00 08",
    ),
    "2.0": ("21 200.300 ER 0008 Rx 4 00 19 08 08", "22 201.3 ST Rx 4 00 00 00 08"),
    "2.1": ("21 200.300 ER 1 0008 Rx - 4 00 19 08 08", "22 201.3 ST 1 - Rx - 4 00 00 00 08"),
}


def trace(tmp_path, version, *more):
    head, row = VERSIONS[version]
    head = head if version == "1.0" else f";$FILEVERSION={version}\n{head}"
    rows = "".join(row.format(n=n, ms=10 * n) + "\n" for n in ROWS)
    return read(tmp_path, "log.trc", head + rows + "".join(f"{line}\n" for line in more))["1"]


@pytest.mark.parametrize("version", VERSIONS)
def test_every_version_of_a_trace(tmp_path, version):
    errors = ERRORS.get(version, ())
    logged = trace(tmp_path, version, *errors)
    assert logged.ident.tolist() == [0x290] * 20
    assert set(np.diff(logged.received_ns)) == {10_000_000}
    assert logged.payload[7, :8].tolist() == [0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 7]
    assert logged.errors_ns.tolist() == ([200_000_000] if errors else [])
    assert logged.remarks == ()


def test_fd_and_remote_frames_of_a_trace(tmp_path):
    more = (
        "21 300.3 FB 1 18FF0001 Rx - 9 " + "AA " * 12,
        "22 310.3 RR 1 0290 Rx - 8",
        "23 320.3 FD 1 0291 Rx - 2 11 22",
    )
    logged = trace(tmp_path, "2.1", *more)
    assert logged.flags[-3:].tolist() == [FD | BIT_RATE_SWITCH | EXTENDED, REMOTE, FD]
    assert logged.length[-3:].tolist() == [12, 8, 2]


def test_a_line_of_a_trace_that_cannot_be_read_and_another_version(tmp_path):
    with pytest.raises(CanrollError, match=r"line 24: not a line of a \.trc: '21 20\.3 XX 1 0290"):
        trace(tmp_path, "2.1", "21 20.3 XX 1 0290 Rx - 1 00")
    with pytest.raises(CanrollError, match=r"a \.trc of version 3\.0: 1\.0, 1\.1, 1\.2"):
        read(tmp_path, "log.trc", ";$FILEVERSION=3.0\n1 1.0 DT 1 0290 Rx - 1 00\n")
