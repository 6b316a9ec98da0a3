"""The age of the commands that come back."""

import pytest
import rig

from canroll.firmware.com import protection
from canroll.firmware.monitors.echo import LATE_ECHOES, note_echo, note_sent, watch_echo
from canroll.firmware.monitors.residual import ECHO
from canroll.firmware.plausibility import FAULT_COMMAND, FAULT_COMMAND_LATE
from canroll.firmware.state import ACTIVE, N_SENT, TX_SUSPENSION_FORCE
from canroll.firmware.subset import I32_MAX, I32_MIN

BIT = 1 << FAULT_COMMAND_LATE
DUE = 5
"""Age of a late command; it is sent again one tick later."""
RULE = {"event_trigger": 1, "trigger_epsilon_squared": 1 << 16, "trigger_floor": 50 << 14}


def driven(delay: int, **changes) -> rig.Bench:
    """An ECU behind which commands lie ``delay`` ticks: they come back one later."""
    cal = rig.calibration(acknowledge_ticks=DUE + 1, **changes)
    return rig.Bench(cal, delay=delay).active().run(1.0, rig.lane_change)


class Sent:
    """The state of an ECU that has sent so many commands, one in each of the last ticks."""

    def __init__(self, commands: int, *, now: int = 1000, every: int = 1, due: int = DUE) -> None:
        self.cal = rig.calibration(acknowledge_ticks=due + 1)
        self.ecu = rig.started(self.cal)
        self.ecu.commands_sent = commands
        self.ecu.tx_counter[TX_SUSPENSION_FORCE] = (commands - 1) % 15
        for k in range(commands):
            self.ecu.time = self.wrapped(now - (commands - 1 - k) * every)
            note_sent(self.ecu)

    @staticmethod
    def wrapped(time: int) -> int:
        return (time - I32_MIN) % (1 << 32) + I32_MIN

    def after(self, ticks: int, counter: int) -> int:
        """Late echoes once ``counter`` comes so many ticks later; the time goes on."""
        self.ecu.time = self.wrapped(self.ecu.time + ticks)
        self.ecu.accepted_counter = counter
        note_echo(self.ecu, self.cal, TX_SUSPENSION_FORCE)
        return self.ecu.evidence[ECHO]


@pytest.mark.parametrize("changes", [{}, RULE], ids=["every tick", "event"])
@pytest.mark.parametrize("late", [False, True])
def test_an_echo_is_late_from_the_time_on_at_which_it_is_due(late, changes):
    bench = driven(DUE - 1 if late else DUE - 2, **changes)
    assert (bench.ecu.fault_latched & BIT != 0) == late
    assert bench.ecu.mode == ACTIVE
    assert bench.ecu.fault_active & ~BIT == 0


def test_the_report_ends_with_an_echo_in_time():
    bench = driven(DUE)
    assert bench.ecu.fault_active & BIT
    bench.delay = 0
    bench.pipe.clear()
    bench.run(0.03)
    assert not bench.ecu.fault_active & BIT
    assert bench.ecu.fault_count[FAULT_COMMAND_LATE] == 1


def test_it_takes_three_late_echoes_in_a_row():
    sent = Sent(10)
    ecu = sent.ecu
    reported = []
    for ticks, counter in ((DUE, 9), (0, 8), (-1, 9), (1, 9), (0, 8), (0, 7), (0, 6)):
        sent.after(ticks, counter)
        ecu.detected = 0
        watch_echo(ecu)
        reported.append(ecu.detected)
    assert reported == [0, 0, 0, 0, 0, BIT, BIT]
    assert ecu.evidence[ECHO] == LATE_ECHOES == 3


def test_what_is_found_beside_it_stays():
    sent = Sent(1)
    sent.ecu.evidence[ECHO] = LATE_ECHOES
    sent.ecu.detected = 1
    watch_echo(sent.ecu)
    assert sent.ecu.detected == BIT | 1


@pytest.mark.parametrize("behind", range(15))
def test_each_command_has_its_own_time(behind):
    """A command every second tick: the one that is k commands old is 2 k ticks old."""
    for due, late in ((2 * behind + 1, 1), (2 * behind + 2, 0)):
        sent = Sent(21, every=2, due=due)
        assert sent.after(1, (20 - behind) % 15) == late


@pytest.mark.parametrize("now", [3, 255, 256, 260, I32_MAX, I32_MIN + 2, -1, 2])
def test_the_clock_may_wrap(now):
    for ticks, late in ((DUE - 1, 0), (DUE, 1)):
        assert Sent(3, now=now).after(ticks, 2) == late


def test_an_echo_of_a_command_before_the_start_is_no_late_one():
    """Two commands, 0 and 1: an echo of another counter is from before."""
    for counter, late in ((1, 1), (0, 1), (2, 0), (7, 0), (14, 0)):
        assert Sent(2).after(50, counter) == late


def test_a_bus_may_count_further_than_the_times_are_kept(monkeypatch):
    """The oldest one that is kept is younger than the command, which is late all the more."""
    monkeypatch.setattr(protection, "TX_LAST_COUNTERS", (255,) * 6)
    for due, late in ((N_SENT - 1, 1), (N_SENT, 0)):
        sent = Sent(40, due=due)
        sent.ecu.tx_counter[TX_SUSPENSION_FORCE] = 10
        # 29 commands ago
        assert sent.after(0, 237) == late


def test_a_counter_that_is_none_is_of_the_newest_command():
    assert Sent(3).after(DUE - 1, 255) == 0
    assert Sent(3).after(DUE, 255) == 1


@pytest.mark.parametrize("changes", [{}, RULE], ids=["every tick", "event"])
def test_lost_commands_and_echoes_are_not_late(changes):
    bench = driven(DUE - 2, **changes)
    for ticks in (1, 2, 7, 15, 16, 40):
        bench.lose_commands = True
        bench.run(0.01 * ticks, rig.lane_change)
        bench.lose_commands = False
        bench.run(0.2, rig.lane_change)
        bench.drop = {"ActuatorState"}
        bench.run(0.01 * ticks, rig.lane_change)
        bench.drop = set()
        bench.run(0.2, rig.lane_change)
    assert not bench.ecu.fault_latched & BIT


def test_commands_that_never_come_back_are_another_fault():
    bench = driven(0)
    bench.lose_commands = True
    bench.run(1.0)
    assert bench.ecu.fault_active >> FAULT_COMMAND & 1
    assert not bench.ecu.fault_latched & BIT


def test_actuators_that_start_anew_are_not_late():
    bench = driven(DUE - 2)
    bench.accepted, bench.held = 15, 0
    bench.pipe.clear()
    bench.run(1.0, rig.lane_change)
    assert not bench.ecu.fault_latched & BIT


@pytest.mark.parametrize("counter", range(15))
def test_an_ecu_that_starts_anew_takes_no_echo_for_late(counter):
    cal = rig.calibration(acknowledge_ticks=DUE + 1)
    bench = rig.Bench(cal, delay=DUE - 2)
    bench.accepted, bench.held = counter, 1
    bench.run(1.0, rig.lane_change)
    assert bench.ecu.fault_latched & BIT == 0
