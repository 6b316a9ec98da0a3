"""Attacks on short runs: nothing gets through authentication, and what does without it is seen."""

from dataclasses import replace

import numpy as np
import pytest

from canroll.cases.execution import Cases, Execution
from canroll.errors import CanrollError
from canroll.extensions.campaign.attacks import kinds, suite
from canroll.extensions.campaign.attacks.attacker import AttackedWorld, Ear, Forged
from canroll.extensions.campaign.attacks.kinds import Attack
from canroll.plant_sim.nodes import authentication, codec_tables
from canroll.runs.experiment import drive, plan, world_options

pytestmark = pytest.mark.slow

LANE_CHANGE = "double_lane_change"
SECURED = pytest.mark.parametrize("loop", ["secured_fd"], indirect=True)


@pytest.fixture(scope="module", params=["500k", "secured_fd"])
def loop(request):
    settings, controller = plan(LANE_CHANGE, bus=request.param)
    return settings, controller, drive(settings, controller, enabled=False)


def test_a_spoofed_command_and_sensor(loop):
    secured = loop[0].firmware.bus.secured
    for message, values in (
        ("AntiRollBarCommand", {"TorqueFront": 2000.0}),
        ("Imu", {"LateralAcceleration": 6.0}),
    ):
        found = suite.outcome(*loop, Attack(message, kinds.spoof(message, values)))
        assert found.sent > 50
        if secured:
            assert found.accepted == 0
            assert max(found.refused) >= found.sent - 5
            assert found.roll_max_deg < 1.7
        else:
            assert found.accepted > found.sent / 2
            assert found.refused is None
            assert found.roll_max_deg > 1.8


def test_one_attack_alone_is_its_row_of_the_suite():
    choices = {"named": "replayed after", "law": "lqr", "duration": None}
    with Execution(jobs=2).cases() as cases:
        every = suite.run(LANE_CHANGE, cases=cases, **choices)
    alone = suite.run(LANE_CHANGE, cases=Cases(execution=Execution(only=2)), **choices)
    assert [outcome.attack for outcome in every.outcomes[3:4]] == ["Imu replayed after 0.1 s"]
    assert alone.outcomes == (every.outcomes[0], every.outcomes[3])


@SECURED
def test_an_attacker_with_the_key_gets_through(loop):
    """The suite tells an accepted frame: of one who has the key."""
    settings = loop[0]
    row = codec_tables.message_index("Imu")
    keys = []

    def forge(ear: Ear):
        for heard in ear.heard("Imu"):
            auth = authentication.build(len(ear.tables.message), key=settings.secret)
            count = int.from_bytes(heard.payload[11:14].tobytes(), "big") + 1
            auth.sent[row] = 1, count
            payload = ear.finished(row, heard.payload.copy())
            authentication.protect(auth, ear.tables, row, payload, False)
            keys.append(count)
            yield ear.forged(row, payload)

    found = suite.outcome(*loop, Attack("owner of the key", forge))
    assert found.accepted > len(keys) / 2
    its = suite.Suite(settings, True, 2.0, (found,))
    assert its.broken
    assert its.accepted == found.accepted


def test_a_bus_of_several_segments_is_refused():
    with pytest.raises(CanrollError, match="gateway_20ms has several segments"):
        suite.run(LANE_CHANGE, bus="gateway_20ms")


@SECURED
@pytest.mark.parametrize("node", ["RollControl", "Imu"])
def test_recorded_frames_after_a_reset(loop, node):
    settings, controller, passive = loop
    attack = next(a for a in kinds.attacks(settings.command) if a.name.endswith(f"reset of {node}"))
    found = suite.outcome(replace(settings, faults=attack.faults), controller, passive, attack)
    assert found.sent > 200
    assert found.accepted == 0


def test_without_an_attack_the_run_is_the_one_without_an_attacker(loop):
    settings, controller, passive = loop
    found = suite.outcome(settings, controller, passive, kinds.NONE)
    plain = drive(settings, controller, enabled=True)
    assert (found.sent, found.accepted) == (0, 0)
    assert found.roll_max_deg == float(np.degrees(np.abs(plain.signals["roll"]).max()))


def test_frames_of_the_attacker_are_told_from_genuine_ones(loop):
    settings = loop[0]
    world = AttackedWorld(**world_options(settings, enabled=True))
    world.attack(kinds.replay("Imu", 0), 0, seed=0)
    told = []
    for k in range(1, 31):
        frames = world.advance(10_000_000 * k)
        assert len(world.arrivals) == len(frames)
        told += world.arrivals
    assert 0 < sum(told) <= world.sent
    assert not all(told)
    assert isinstance(world.ear.all[0].payload, np.ndarray)
    assert Forged(0, 8, 0, np.zeros(8, np.uint8)).delay_ns == 0
