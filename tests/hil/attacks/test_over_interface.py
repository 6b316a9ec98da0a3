"""Attacks over a python-can interface: attacker, vehicle and ECU are three nodes on it."""

import threading

import can
import pytest

from codegen.run.backends import open_backend
from codegen.run.secured import NEW, SecuredEcu
from hil.attacks import kinds, suite
from hil.attacks.kinds import Attack
from hil.attacks.over_interface import drive
from hil.cli.main import main
from hil.realtime import ecu_loop, plant_loop, tick_trace
from hil.realtime.bus_link import CanLink
from hil.realtime.lockstep import ACKNOWLEDGEMENT, GRANT, Grants, InBand
from hil.realtime.process import Stop
from hil.runs import experiment
from hil.runs.experiment import plan


class Interface:
    """A virtual interface with an ECU program that runs in a thread."""

    def __init__(self, name, settings, controller):
        self.name, self.settings, self.record = name, settings, controller.record
        self.firmware = settings.firmware
        self.link = CanLink(self.bus(), fd=self.firmware.fd)
        self.attacker = self.bus()
        self.lasting, self.starts = NEW, 0

    def bus(self):
        return can.Bus(self.name, interface="virtual", protocol="CAN_FD")

    def start(self):
        self.starts += 1
        self.before = self.lasting
        self.ecu = open_backend("native", self.record, self.firmware, lasting=self.lasting)
        self.recorder = tick_trace.Recorder(room=self.firmware.room)
        self.halt = Stop()
        link = CanLink(self.bus(), fd=self.firmware.fd)
        grants = Grants(
            link,
            InBand(link, sends=ACKNOWLEDGEMENT, hears=GRANT),
            idents=plant_loop.sent_to(self.firmware),
            foreign=plant_loop.sent_by(self.firmware),
            tick_us=self.record.tick_us,
            stop=self.halt,
        )

        def run():
            ecu_loop.run_granted(
                self.ecu,
                link,
                grants,
                self.recorder,
                self.record,
                stop=self.halt,
                firmware=self.firmware,
            )
            link.close()

        self.thread = threading.Thread(target=run, daemon=True)
        self.thread.start()
        return self

    def stop(self):
        self.halt.requested = True
        self.thread.join(60)
        about = {}
        if isinstance(self.ecu, SecuredEcu):
            about = {"lasting": [self.before.starts, self.before.senders]}
            self.lasting = self.ecu.lasting
        recorder = self.recorder
        return tick_trace.TickTrace(self.record, recorder.ticks(), recorder.frames(), about)

    def close(self):
        self.link.close()
        self.attacker.shutdown()


@pytest.fixture(scope="module", params=["500k", "secured_fd"])
def loop(request):
    settings, controller = plan("double_lane_change", bus=request.param, backend="native")
    return settings, controller, experiment.drive(settings, controller, enabled=False)


@pytest.fixture
def attacked(loop, request):
    """Drive an attack over an interface of its own, and judge it."""
    made = []

    def under(settings, controller, attack):
        its = Interface(f"{request.node.name}-{len(made)}", settings, controller)
        made.append(its)
        return drive(
            settings, controller, attack, link=its.link, attacker=its.attacker, ecu=its.start
        )

    def outcome(attack):
        settings, controller, passive = loop
        its = experiment.replace(settings, faults=attack.faults)
        return suite.outcome(its, controller, passive, attack, under=under)

    outcome.made = made
    yield outcome
    for its in made:
        its.close()


def named(loop, text):
    return next(a for a in kinds.attacks(loop[0].command) if text in a.name)


def test_without_an_attack_it_is_the_run_of_virtual_time(loop, attacked):
    settings, controller, passive = loop
    found = attacked(kinds.NONE)
    assert found == suite.outcome(settings, controller, passive, kinds.NONE)


def test_a_spoofed_command_is_bounded_without_authentication_and_refused_with_it(loop, attacked):
    spoofed = Attack("spoofed", kinds.spoof("AntiRollBarCommand", {"TorqueFront": 2000.0}))
    found = attacked(spoofed)
    assert found.sent > 50
    if loop[0].firmware.bus.secured:
        assert found.accepted == 0
        assert found.refused[1] >= found.sent - 5
        assert found.roll_max_deg < 1.7
    else:
        assert found.accepted > found.sent / 2
        assert 1.8 < found.roll_max_deg < 3.5


@pytest.mark.slow
@pytest.mark.parametrize(
    "text",
    [
        "spoofed Imu: LateralAcceleration",
        "Imu replayed after 0.1 s",
        "AntiRollBarCommand replayed after 0.1 s",
        "Imu of another length",
        "AntiRollBarCommand of another length",
        "Imu as classic for FD",
        "AntiRollBarCommand as classic for FD",
        "Imu with 29 bits",
        "flood of Imu",
        "recorded Imu after a reset of Imu",
        "recorded AntiRollBarCommand after a reset of Actuator",
    ],
)
def test_other_attacks(loop, attacked, text):
    found = attacked(named(loop, text))
    assert found.sent > 50
    if loop[0].firmware.bus.secured:
        assert found.accepted == 0
        # a node that is down costs control, whoever attacks
        assert "reset" in text or found.roll_max_deg < 1.7
    elif any(word in text for word in ("length", "as classic", "29 bits")):
        assert found.accepted == 0
    elif "Imu" in text:
        assert found.accepted > 0


def test_an_ecu_that_was_reset_is_heard_again_and_takes_nothing_recorded(loop, attacked):
    found = attacked(named(loop, "recorded Imu after a reset of RollControl"))
    (interface,) = attacked.made
    assert interface.starts == 2
    assert found.sent > 50
    if loop[0].firmware.bus.secured:
        assert found.accepted == 0
        assert interface.ecu.lasting.starts == 2
        # the actuators, too, refuse the recorded frames, and none of the second start
        assert found.refused[1] <= found.sent
        assert found.harm == ()


def test_options_that_cannot_be_are_one_line(capsys):
    assert main(["attacks", "-i", "virtual", "-c", "x"]) == 2
    assert "-i virtual works only within one process" in capsys.readouterr().err
    assert main(["attacks", "--attack", "sideways"]) == 2
    assert "no attack has 'sideways' in its name" in capsys.readouterr().err
