"""What an interrupt may do to the loop, derived from the sources; what is unsafe is refused."""

import pytest

from canroll.codegen.export import interrupts
from canroll.codegen.run.bus_firmware import AUTHENTICATION, built_in, with_services
from canroll.codegen.run.service import SERVICES
from canroll.codegen.subset.parse import load
from canroll.errors import CanrollError

MODULE = '''
"""Sample."""
from canroll.firmware.state import Calibration, Ecu
from canroll.firmware.subset import i32


def receive(ecu: Ecu, message: i32) -> None:
    """Called from an interrupt."""
    {receive}


def tick(ecu: Ecu, cal: Calibration) -> None:
    """The loop."""
    {tick}
'''


def program(sample, receive, tick):
    sample.write("")
    (sample.path / "sample.py").write_text(MODULE.format(receive=receive, tick=tick).lstrip("\n"))
    return load("sample", sample.path)


def test_the_firmware_keeps_to_its_contract():
    found = interrupts.check()
    assert set(found) == {"canroll_init", "canroll_receive", "canroll_tick"}
    receive, tick = found["canroll_receive"], found["canroll_tick"]
    assert receive.writes == of("Ecu", "rx_payload", "rx_fresh", "rx_own")
    assert receive.reads == of("Ecu", "rx_side")
    assert tick.calibrated and not receive.calibrated
    assert of("Ecu", "x", "mode", "tx_payload", "tx_pending") <= tick.writes
    assert not of("Ecu", "rx_payload") & tick.writes


def of(record, *fields):
    return {(record, field) for field in fields}


def test_services_keep_to_it_too():
    entries = interrupts.check(with_services(built_in(), (*SERVICES, AUTHENTICATION)).program())
    assert entries["canroll_tick"] == interrupts.check()["canroll_tick"]
    assert entries["canroll_xcp_receive"].writes == of("Xcp", "rx_payload", "rx_length", "rx_fresh")
    assert entries["canroll_uds_receive"].writes == of("Uds", "rx_payload", "rx_fresh")
    assert entries["canroll_receive"].writes == of("Ecu", "rx_payload", "rx_fresh", "rx_own")


@pytest.mark.parametrize(
    ("receive", "tick", "word"),
    [
        ("ecu.count = 1", "ecu.small = 2", "receive uses count, which is not volatile"),
        ("ecu.bytes[0] = 1", "ecu.small = ecu.count", None),
        ("ecu.bytes[0] = ecu.small", "ecu.count = 2", "receive uses small, which is not vol"),
        ("ecu.bytes[0] = 1", "ecu.bytes[1] = 2", "receive and canroll_tick both write bytes"),
    ],
)
def test_an_unsafe_interrupt_is_refused(sample, receive, tick, word):
    its = program(sample, receive, tick)
    if word is None:
        assert interrupts.check(its)["canroll_tick"].reads == of("Ecu", "count")
    else:
        with pytest.raises(CanrollError, match=word):
            interrupts.check(its)


SERVICE = '''
"""A service."""
from typing import Annotated
from canroll.firmware.state import Ecu
from canroll.firmware.subset import F, i32, octet, record, u8


@record
class Own:
    """Of the service."""

    count: Annotated[i32, F(0, 300, 0, "", "count")]
    rx_fresh: Annotated[u8, F(0, 1, 0, "", "mark", True)]
    bytes: Annotated[list[u8], 8, F(0, 255, 0, "", "mailbox", True)]


def receive(own: Own, ecu: Ecu, message: i32) -> None:
    """Called from an interrupt."""
    {receive}


def tick(own: Own, ecu: Ecu) -> None:
    """After the loop."""
    own.rx_fresh = 0
    {tick}
'''


@pytest.mark.parametrize(
    ("receive", "tick", "word"),
    [
        ("own.rx_fresh = 1", "own.count = 2", None),
        ("own.count = 1", "own.bytes[0] = 2", "canroll_other_receive uses count, which is not"),
        ("own.bytes[0] = octet(ecu, 0)", "own.count = 1", "canroll_other_receive uses count"),
        ("own.bytes[0] = 1", "own.bytes[1] = 2", "_other_receive and canroll_other_tick both wr"),
        ("ecu.bytes[0] = 1", "own.count = 2", "canroll_receive and canroll_other_receive both"),
    ],
)
def test_an_unsafe_interrupt_of_a_service_is_refused(sample, receive, tick, word):
    program(sample, "ecu.bytes[1] = 1", "ecu.count = 2")
    (sample.path / "other.py").write_text(SERVICE.format(receive=receive, tick=tick).lstrip("\n"))
    served = load("sample", sample.path, services=["other"])
    if word is None:
        assert interrupts.check(served)["canroll_other_tick"].writes == of(
            "Own", "rx_fresh", "count"
        )
    else:
        with pytest.raises(CanrollError, match=word):
            interrupts.check(served)
