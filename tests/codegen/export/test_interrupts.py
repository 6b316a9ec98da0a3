"""What an interrupt may do to the loop, derived from the sources; what is unsafe is refused."""

import pytest

from canroll.errors import CanrollError
from codegen.export import interrupts
from codegen.subset.parse import load

MODULE = '''
"""Sample."""
from firmware.state import Calibration, Ecu
from firmware.subset import i32


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
    assert set(found) == {"init", "receive", "tick"}
    assert found["receive"].writes == {"rx_payload", "rx_fresh", "rx_own"}
    assert found["receive"].reads == {"rx_side"}
    assert found["tick"].calibrated and not found["receive"].calibrated
    assert {"x", "mode", "tx_payload", "tx_pending"} <= found["tick"].writes
    assert "rx_payload" not in found["tick"].writes


@pytest.mark.parametrize(
    ("receive", "tick", "word"),
    [
        ("ecu.count = 1", "ecu.small = 2", "receive uses count, which is not volatile"),
        ("ecu.bytes[0] = 1", "ecu.small = ecu.count", None),
        ("ecu.bytes[0] = ecu.small", "ecu.count = 2", "receive uses small, which is not vol"),
        ("ecu.bytes[0] = 1", "ecu.bytes[1] = 2", "receive and tick both write bytes"),
    ],
)
def test_an_unsafe_interrupt_is_refused(sample, receive, tick, word):
    its = program(sample, receive, tick)
    if word is None:
        assert interrupts.check(its)["tick"].reads == {"count"}
    else:
        with pytest.raises(CanrollError, match=word):
            interrupts.check(its)
