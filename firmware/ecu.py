"""The three entry points of the ECU: ``init``, ``receive``, ``tick``.

The caller owns both records. It calls ``receive`` for every frame, which may be from an
interrupt, ``tick`` once a period with the number of periods elapsed, and then sends every slot
whose ``tx_pending`` is 1 and clears it.
"""

from canroll.firmware import stage
from canroll.firmware.allocation import allocate
from canroll.firmware.calibration import Calibration
from canroll.firmware.check import RULE_CRC, check, watch_calibration
from canroll.firmware.com.mailbox import init_mailboxes, read_inputs, receive
from canroll.firmware.com.transmit import init_transmit, transmit
from canroll.firmware.control_law import control, init_control
from canroll.firmware.event_trigger import init_trigger, trigger
from canroll.firmware.identification import identify, init_identification
from canroll.firmware.limits import LAST_WORD
from canroll.firmware.monitors import envelope
from canroll.firmware.observer import init_observer, learn_offsets, look_ahead, observe
from canroll.firmware.plausibility import FAULT_CALIBRATION, FAULT_CALIBRATION_CRC, latch_faults
from canroll.firmware.schedule import schedule
from canroll.firmware.state import AGE_MAX, CORRUPT, SAFE, Ecu
from canroll.firmware.subset import I32_MAX, clamp, clear, i32, i64, narrow
from canroll.firmware.supervisor import init_supervisor, supervise

__all__ = ["init", "receive", "tick"]

STEPS_MAX = 16
WRAP = 1 << 32


def init(ecu: Ecu, cal: Calibration) -> i32:
    """Start the ECU; return 0, or why the calibration is refused: 511 its CRC, else as ``check``.

    A refused calibration never runs: the mode is SAFE and every later tick does nothing.
    """
    clear(ecu)
    for _ in range(LAST_WORD):
        watch_calibration(ecu, cal)
    ecu.refused = RULE_CRC
    fault: i32 = 1 << FAULT_CALIBRATION_CRC
    if ecu.calibration_word != CORRUPT:
        ecu.refused = check(cal)
        fault = 1 << FAULT_CALIBRATION
    if ecu.refused != 0:
        ecu.mode = SAFE
        ecu.detected = fault
        latch_faults(ecu)
        return ecu.refused
    init_mailboxes(ecu, cal)
    init_supervisor(ecu)
    init_observer(ecu, cal)
    init_identification(ecu, cal)
    init_control(ecu, cal)
    init_trigger(ecu)
    init_transmit(ecu)
    ecu.law = cal.law
    stage.start(ecu, cal)
    return 0


def tick(ecu: Ecu, cal: Calibration, elapsed_ticks: i32) -> None:
    """Run one period of the loop; ``elapsed_ticks`` is more than 1 where ticks were missed.

    Ages, ramps and timeouts count all of them, estimate and slew limit at most ``STEPS_MAX``.
    Missed ticks are made up for in one step, so that a late tick is hardly longer than any other.
    """
    if ecu.refused != 0:
        return
    elapsed: i32 = clamp(elapsed_ticks, 1, AGE_MAX)
    steps: i32 = clamp(elapsed, 1, STEPS_MAX)
    read_inputs(ecu, cal, elapsed)
    watch_calibration(ecu, cal)
    supervise(ecu, cal, elapsed)
    schedule(ecu, cal)
    learn_offsets(ecu, cal)
    observe(ecu, cal, steps)
    stage.estimate(ecu, cal, steps)
    identify(ecu, cal, elapsed)
    look_ahead(ecu, cal)
    control(ecu, cal, steps)
    envelope.guard(ecu, cal, elapsed)
    allocate(ecu, cal)
    envelope.bound(ecu, cal)
    trigger(ecu, cal, elapsed)
    transmit(ecu, cal, elapsed)
    time: i64 = ecu.time + elapsed
    if time > I32_MAX:
        time -= WRAP
    ecu.time = narrow(time)
