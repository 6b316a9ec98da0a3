"""Work that a calibration or a speed makes needless is left out, and nothing else changes."""

from fractions import Fraction

from hypothesis import given
from hypothesis import strategies as st

from canroll.firmware import schedule
from canroll.firmware.calibration import Calibration
from canroll.firmware.com import mailbox
from canroll.firmware.com.signals import RX_SIGNALS
from canroll.firmware.state import RX_SUSPENSION_RATE, Ecu


@given(st.integers(0, 1 << 30), st.integers(1, 1 << 30))
def test_a_share_is_the_quotient_at_most_one(part, whole):
    assert schedule.ratio(part, whole) == min(Fraction(part * 2**28, whole), 2**28) // 1


def test_a_message_without_timeout_is_not_taken():
    payload = [0, 0, 255, 255, 0, 0, 0, 16]
    for timeout, taken in ((0, 0), (5, 1)):
        ecu, cal = Ecu(), Calibration()
        cal.e2e = 0
        cal.timeout_ticks[RX_SUSPENSION_RATE] = timeout
        mailbox.init_mailboxes(ecu, cal)
        mailbox.receive(ecu, RX_SUSPENSION_RATE, payload, 8)
        mailbox.read_inputs(ecu, cal, 3)
        assert ecu.fresh[RX_SUSPENSION_RATE] == taken * RX_SIGNALS[RX_SUSPENSION_RATE]
        assert ecu.valid[RX_SUSPENSION_RATE] == 15 * taken
        assert (ecu.last_sample[RX_SUSPENSION_RATE] == mailbox.NO_SAMPLE) == (not taken)
