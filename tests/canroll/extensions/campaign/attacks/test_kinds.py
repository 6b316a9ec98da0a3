"""What each attack sends, from frames made up on an authenticated and on a plain bus."""

import numpy as np
import pytest

from canroll import dbc
from canroll.codegen.generated.bus_map import load
from canroll.extensions.campaign.attacks import kinds
from canroll.extensions.campaign.attacks.attacker import Ear, Heard
from canroll.plant_sim.can_bus.wire.frame import BIT_RATE_SWITCH, EXTENDED, FD
from canroll.plant_sim.faults import parse
from canroll.plant_sim.nodes import authentication, codec, codec_tables, e2e
from canroll.plant_sim.nodes.actuators import COMMANDS

COMMAND = "AntiRollBarCommand"
SECURED = codec_tables.of_map(load(dbc.SECURED_PATH, dbc.SECURED_MAP))
PLAIN = codec_tables.load()
KEY = bytes(range(16))


def ear_of(tables):
    return Ear(tables, tables is SECURED, np.random.default_rng(1))


def heard(ear, message, count=5, auth=None, payload=None):
    """Let the attacker hear a genuine frame."""
    row = codec_tables.message_index(message)
    frame = np.zeros(codec.MAX_PAYLOAD, np.uint8)
    if payload is not None:
        frame[: len(payload)] = payload
    tables = ear.tables
    e2e.protect(tables.protection[row], count, frame)
    if auth is not None:
        authentication.protect(auth, tables, row, frame, False)
    length, flags = tables.message[row]["length"], tables.message[row]["flags"]
    found = Heard(ear.now_ns, row, int(length), int(flags), frame)
    ear.new = [found]
    ear.all = [*ear.all, found]
    return found


def sent(forge, ear):
    return list(forge(ear))


def intact(ear, forged):
    row, tables = forged.row, ear.tables
    return e2e.intact(tables.protection[row], forged.payload)


@pytest.mark.parametrize("tables", [PLAIN, SECURED], ids=["plain", "secured"])
def test_a_spoofed_frame_is_right_in_all_but_the_mac(tables):
    ear, auth = ear_of(tables), authentication.build(len(tables.message), key=KEY)
    genuine = heard(ear, "Imu", auth=auth if tables is SECURED else None)
    (forged,) = sent(kinds.spoof("Imu", {"LateralAcceleration": 6.0}), ear)
    assert intact(ear, forged)
    assert (forged.length, forged.flags) == (genuine.length, genuine.flags)
    at = codec_tables.signal_index("Imu", "LateralAcceleration")
    assert codec.extract(tables, at, forged.payload) == round(6.0 / 0.00125)
    assert forged.payload[1] & 15 == 6
    counter = codec_tables.signal_index("Imu", "SampleCounter")
    assert codec.extract(tables, counter, forged.payload) == 1
    if tables is SECURED:
        assert forged.payload[8:14].tolist() == [0, 0, 0, 0, 0, 1]
        assert forged.payload[14:20].tolist() == genuine.payload[14:20].tolist()


def test_a_frame_that_was_not_heard_is_not_answered():
    ear = ear_of(SECURED)
    heard(ear, COMMAND)
    assert sent(kinds.spoof("Imu", {"RollRate": 0.5}), ear) == []


def test_replays_are_the_bytes_that_were_heard():
    ear = ear_of(SECURED)
    first = heard(ear, "Imu", 1)
    second = heard(ear, "Imu", 2)
    (late,) = sent(kinds.replay("Imu", 100), ear)
    assert late.payload.tobytes() == second.payload.tobytes()
    assert late.delay_ns == 100
    (old,) = sent(kinds.replay_first("Imu"), ear)
    assert old.payload.tobytes() == first.payload.tobytes()


def test_a_flipped_frame_differs_by_a_bit_besides_its_counters():
    ear = ear_of(SECURED)
    genuine = heard(ear, "Imu")
    expected = ear.following(genuine)
    (forged,) = sent(kinds.flip("Imu"), ear)
    assert forged.payload.tobytes() != expected.tobytes()


def test_a_guess_has_another_mac_and_the_right_checksum():
    ear = ear_of(SECURED)
    genuine = heard(ear, COMMAND)
    (forged,) = sent(kinds.guess(COMMAND), ear)
    assert intact(ear, forged)
    assert forged.payload[14:20].tolist() != genuine.payload[14:20].tolist()


def test_a_disguise_has_the_bytes_of_another_message():
    ear = ear_of(SECURED)
    heard(ear, "Imu", payload=[0, 0, 7, 7, 7, 7, 7, 7])
    heard(ear, COMMAND)
    (forged,) = sent(kinds.disguise(COMMAND), ear)
    assert forged.row == codec_tables.message_index(COMMAND)
    assert forged.payload[2:7].tolist() == [7] * 5
    assert intact(ear, forged)


@pytest.mark.parametrize("tables", [PLAIN, SECURED], ids=["plain", "secured"])
def test_lengths_and_formats_are_others(tables):
    ear = ear_of(tables)
    genuine = heard(ear, "Imu")
    for _ in range(20):
        (forged,) = sent(kinds.resize("Imu", (0, 4, 7, 12, 16, 64)), ear)
        assert forged.length != genuine.length
        assert forged.length <= 8 or forged.flags & FD
    (other,) = sent(kinds.reformat("Imu", FD), ear)
    assert bool(other.flags & FD) != bool(genuine.flags & FD)
    assert other.flags & FD or (other.length == 8 and not other.flags & BIT_RATE_SWITCH)
    (wide,) = sent(kinds.reformat("Imu", EXTENDED), ear)
    assert wide.flags == genuine.flags | EXTENDED


@pytest.mark.parametrize(
    ("ahead", "expected"),
    [(1000, 1001), (1 << 24, (1 << 24) + 1), (-2, 2**48 - 1), (1 << 47, (1 << 47) + 1)],
)
def test_a_jump_moves_the_freshness_value(ahead, expected):
    ear = ear_of(SECURED)
    heard(ear, "Imu")
    (forged,) = sent(kinds.jump("Imu", ahead), ear)
    assert int.from_bytes(forged.payload[8:14].tobytes(), "big") == expected


def test_a_flood_counts_on_and_goes_on_without_genuine_frames():
    ear = ear_of(SECURED)
    forge = kinds.flood("Imu")
    assert sent(forge, ear) == []
    heard(ear, "Imu", 3)
    first = sent(forge, ear)
    ear.new = []
    found = [*first, *sent(forge, ear)]
    assert len(found) == 2 * kinds.PER_TURN
    assert all(intact(ear, forged) for forged in found)
    assert [forged.payload[1] & 15 for forged in found] == [4, 5, 6, 7, 8, 9]
    assert [forged.payload[13] for forged in found] == [1, 2, 3, 4, 5, 6]


def test_recorded_frames_come_when_the_node_is_back():
    ear = ear_of(SECURED)
    forge = kinds.after_reset("Imu")
    recorded = heard(ear, "Imu")
    ear.now_ns = kinds.BACK_NS - kinds.MS
    assert sent(forge, ear) == []
    ear.now_ns = kinds.BACK_NS
    later = heard(ear, "Imu", 6)
    assert later.t_ns == kinds.BACK_NS
    (forged,) = sent(forge, ear)
    assert forged.payload.tobytes() == recorded.payload.tobytes()
    ear.now_ns = kinds.BACK_NS + kinds.LISTENING_NS
    assert sent(forge, ear) == []


@pytest.mark.parametrize("command", sorted({c[0] for taken in COMMANDS.values() for c in taken}))
def test_every_command_has_its_attacks(command):
    found = kinds.attacks(command)
    assert len({attack.name for attack in found}) == len(found) > 30
    assert all(parse(text) for attack in found for text in attack.faults)
