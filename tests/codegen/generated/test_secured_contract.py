"""The authenticated contract: current, the plain one with 12 bytes more, and what a map may say."""

import cantools
import pytest

from canroll import dbc
from canroll.codegen.generated import secured_contract
from canroll.codegen.generated.bus_map import load
from canroll.errors import CanrollError


def test_both_files_are_current():
    assert dbc.SECURED_PATH.read_text(encoding="utf-8") == secured_contract.database()
    assert dbc.SECURED_MAP.read_text(encoding="utf-8") == secured_contract.map_text()


def test_every_frame_is_that_of_the_contract_with_freshness_and_mac():
    secured = cantools.database.load_file(dbc.SECURED_PATH)
    assert len(secured.messages) == len(dbc.load().messages)
    for plain in dbc.load().messages:
        its = secured.get_message_by_name(plain.name)
        assert (its.frame_id, its.length, its.is_fd) == (plain.frame_id, 20, True)
        assert (its.cycle_time, its.senders) == (plain.cycle_time, plain.senders)
        assert dbc.data_id(its) == dbc.data_id(plain)
        extra = {signal.name for signal in its.signals} - {s.name for s in plain.signals}
        assert extra == {"Freshness", "Authenticator"}
        data = bytes(range(40, 48))
        found = its.decode(data + bytes.fromhex("010004000203a1a2a3a4a5a6"), decode_choices=False)
        assert found.pop("Freshness") == 0x010004000203
        assert found.pop("Authenticator") == 0xA1A2A3A4A5A6
        try:
            assert found == plain.decode(data, decode_choices=False)
        except cantools.database.DecodeError:
            assert plain.is_multiplexed()


def test_the_loop_sees_the_plain_frames():
    secured, plain = (
        load(dbc.SECURED_PATH, dbc.SECURED_MAP),
        load(dbc.PATH, dbc.PATH.with_suffix(".toml")),
    )
    assert secured.secured and not plain.secured
    for one, other in zip(secured.frames, plain.frames, strict=True):
        assert (one.ident, one.length, one.protection) == (other.ident, 8, other.protection)
        assert (one.sent_length, one.fd, one.bit_rate_switch) == (20, True, True)


@pytest.mark.parametrize(
    ("of", "old", "new", "message"),
    [
        ("map", 'freshness = "Freshness"', 'fresh = "Freshness"', "unknown key"),
        ("map", 'freshness = "Freshness"', "freshness = 5", "must be the name of a signal"),
        ("map", 'freshness = "Freshness"', 'freshness = "Fresh"', "unknown signal of Imu"),
        ("map", 'freshness = "Freshness"', 'freshness = "RollRate"', "must be bytes 8 to 13"),
        ("dbc", "BO_ 160 Imu: 20", "BO_ 160 Imu: 24", "must be a CAN FD frame of 20 bytes"),
        ("dbc", 'BA_ "VFrameFormat" BO_ 160 14;', "", "Imu has 20 bytes but is not a CAN FD"),
        ("dbc", 'BA_ "E2EDataLength" BO_ 160 64;', "", "needs a data id of E2E profile 1"),
        ("dbc", 'BA_ "E2EDataId" BO_ 160 3232;', "", "needs a data id of E2E profile 1"),
        ("map", 'message = "VehicleMotion"', 'message = "Imu"', "unknown signal"),
    ],
)
def test_what_cannot_be_authenticated_is_refused(tmp_path, of, old, new, message):
    files = {"dbc": dbc.SECURED_PATH, "map": dbc.SECURED_MAP}
    for name, path in files.items():
        text = path.read_text(encoding="utf-8")
        if name == of:
            assert old in text
            text = text.replace(old, new, 1)
        files[name] = tmp_path / path.name
        files[name].write_text(text, encoding="utf-8")
    with pytest.raises(CanrollError, match=message) as refusal:
        load(files["dbc"], files["map"])
    assert "\n" not in str(refusal.value)


def test_a_frame_of_two_mailboxes_is_refused(tmp_path):
    text = dbc.SECURED_MAP.read_text(encoding="utf-8")
    first, end = text.index("[receive.roll_reference]"), text.index("[transmit.suspension_force]")
    shared = (
        '[receive.roll_reference]\nmessage = "Imu"\n'
        'signals.LateralAcceleration = "reference_acceleration"\n\n'
    )
    path = tmp_path / "own.toml"
    path.write_text(text[:first] + shared + text[end:], encoding="utf-8")
    with pytest.raises(CanrollError, match="Imu is in the mailboxes imu and roll_reference"):
        load(dbc.SECURED_PATH, path)
