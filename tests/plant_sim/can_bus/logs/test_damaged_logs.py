"""Damaged and foreign files of every format: refused or read, never in the words of Python."""

import gzip
import random
import re

import can
import numpy as np
import pytest

from canroll.errors import CanrollError
from canroll.plant_sim.can_bus.logs import databases
from canroll.plant_sim.can_bus.traffic.log_reader import LOGS, read_log

FRAMES = 60
FOREIGN_WORDS = re.compile(
    r"unpack|invalid literal|NoneType|Traceback|object has no attribute|Error\b|Exception|codec"
    r"|expected str|could not convert|not subscriptable|out of range|argument|struct|list index"
    r"|must be (?:str|int|real)|read length|buffer|asammdf|sqlite3|magic|unsupported operand"
)
COSTLY = ".mf4"
"""Read by a process of its own."""


def messages():
    for k in range(FRAMES):
        yield can.Message(
            timestamp=1e-3 * k,
            arbitration_id=0x80 + k % 3,
            is_extended_id=False,
            data=bytes(k % 9),
            channel=0,
        )


EACH = [pytest.param(s, marks=pytest.mark.slow) if s == COSTLY else s for s in LOGS]


@pytest.fixture(scope="module", params=EACH)
def good(request, tmp_path_factory):
    path = tmp_path_factory.mktemp("logs") / f"log{request.param}"
    if request.param == COSTLY:
        pytest.importorskip("asammdf")
    with can.Logger(str(path)) as logger:
        for message in messages():
            logger(message)
    return path


def damaged(content, suffix):
    """Contents that are none of the format, or were once."""
    yield b""
    yield bytes(4096)
    yield b"this is not a log at all\n" * 20
    yield b"\x89PNG\r\n\x1a\n" + random.Random(1).randbytes(2000)
    yield content[:100]
    yield content[: len(content) // 2]
    yield content[:-7]
    if suffix == COSTLY:
        return
    draw = random.Random(2)
    for _ in range(60):
        changed = bytearray(content)
        for _ in range(draw.choice((1, 4, 40))):
            changed[draw.randrange(len(changed))] = draw.randrange(256)
        yield bytes(changed)


def remarks_of(path):
    """Return the lines said of a log, whether it is read or refused."""
    try:
        return [remark for logged in read_log(path).values() for remark in logged.remarks]
    except CanrollError as error:
        return [str(error)]


def test_a_good_log_is_read_without_a_word(good):
    (logged,) = read_log(good).values()
    assert len(logged.ident) == FRAMES
    assert logged.remarks == ()


def test_damage_is_said_in_a_line_of_ours(good, tmp_path, capfd):
    path = tmp_path / good.name
    for content in damaged(good.read_bytes(), good.suffix):
        path.write_bytes(content)
        for line in remarks_of(path):
            assert "\n" not in line
            assert not FOREIGN_WORDS.search(line.replace(str(path), "")), line
    assert capfd.readouterr().err == ""


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".blf", ".mf4", ".db", ".pcap", ".pcapng"])
def test_a_binary_file_of_another_kind_is_called_so(tmp_path, suffix):
    path = tmp_path / f"fake{suffix}"
    for content in (b"", bytes(4096), b"some text\n" * 100):
        path.write_bytes(content)
        with pytest.raises(CanrollError, match=r"damaged, or not an? |neither a \.pcap nor a"):
            read_log(path)


def test_a_packed_log_is_read_like_another(good, tmp_path):
    path = tmp_path / f"{good.name}.gz"
    path.write_bytes(gzip.compress(good.read_bytes()))
    (logged,) = read_log(path).values()
    (before,) = read_log(good).values()
    assert logged.ident.tolist() == before.ident.tolist()
    assert logged.received_ns.tolist() == before.received_ns.tolist()


@pytest.mark.parametrize(
    "content", [b"no gzip", gzip.compress(b"(1.0) can0 0A0#11\n", mtime=0)[:-9]]
)
def test_a_damaged_archive_is_called_so(tmp_path, content):
    path = tmp_path / "log.log.gz"
    path.write_bytes(content)
    with pytest.raises(CanrollError, match="damaged, or not packed by gzip"):
        read_log(path)


def test_a_log_of_which_nothing_remains_says_why(tmp_path):
    path = tmp_path / "log.log"
    path.write_text("(1.0) can0 FFF#00\n")
    with pytest.raises(CanrollError, match=r"contains no frame; line 1: identifier FFF"):
        read_log(path)


def test_an_mf4_without_its_package_names_the_extra(tmp_path, monkeypatch):
    path = tmp_path / "log.mf4"
    path.write_bytes(b"MDF     4.10")
    monkeypatch.setattr(databases, "find_spec", lambda name: None)
    with pytest.raises(CanrollError, match=r"needs asammdf: pip install 'canroll\[asammdf\]'"):
        read_log(path)


def test_an_mf4_of_signals_alone_is_called_so(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    path = tmp_path / "signals.mf4"
    with asammdf.MDF() as file:
        times = np.arange(10) * 0.1
        file.append(asammdf.Signal(times, times, name="roll"))
        file.save(path)
    with pytest.raises(CanrollError, match="an MF4 without CAN frames: its bus logging is needed"):
        read_log(path)


def test_what_python_can_does_not_read_of_an_mf4_is_counted(tmp_path, monkeypatch):
    """A group without its source is passed over by python-can."""
    asammdf = pytest.importorskip("asammdf")
    path = tmp_path / "log.mf4"
    with can.Logger(str(path)) as logger:
        for message in messages():
            logger(message)
        logger(can.Message(timestamp=1.0, arbitration_id=0x80, is_remote_frame=True, channel=0))
    with asammdf.MDF(path) as file:
        for group in file.groups:
            if any(channel.name == "CAN_RemoteFrame" for channel in group.channels):
                group.channel_group.acq_source = None
        file.save(tmp_path / "less.mf4")
    (logged,) = read_log(path).values()
    assert (len(logged.ident), logged.remarks) == (FRAMES + 1, ())
    (logged,) = read_log(tmp_path / "less.mf4").values()
    assert logged.remarks == ("1 remote frames are there, 0 can be read",)
