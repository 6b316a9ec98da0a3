"""Key files: both forms, and what is refused without showing what is in them."""

import pytest

from canroll import documents
from canroll.dbc.keys import DEVELOPMENT_KEY, KEY_BYTES, read_key
from canroll.errors import CanrollError

DIGITS = "00112233445566778899AabbCcddEeff"


def file_of(folder, text, mode=0o600):
    path = folder / "bus.key"
    path.write_text(text, encoding="utf-8")
    path.chmod(mode)
    return path


@pytest.mark.parametrize("text", [DIGITS, f"{DIGITS}\n", f'# of the bus\nkey = "{DIGITS}"\n'])
def test_either_form_is_read(tmp_path, text):
    assert read_key(file_of(tmp_path, text)) == bytes.fromhex(DIGITS)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "32 hexadecimal digits"),
        (DIGITS[:-1], "32 hexadecimal digits"),
        (DIGITS[:-1] + "g", "32 hexadecimal digits"),
        (f"key = {DIGITS}", "neither a key nor TOML"),
        (f'kay = "{DIGITS}"', "must have one entry"),
        ("key = 5", "must have one entry"),
        (DEVELOPMENT_KEY.hex(), "public development key"),
    ],
)
def test_what_is_no_key_is_refused_and_not_shown(tmp_path, text, message):
    with pytest.raises(CanrollError, match=message) as refusal:
        read_key(file_of(tmp_path, text))
    assert "\n" not in str(refusal.value)
    assert DIGITS[:8] not in str(refusal.value)


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o660, 0o644])
def test_a_key_that_others_may_read_is_refused(tmp_path, mode):
    path = file_of(tmp_path, DIGITS, mode)
    with pytest.raises(CanrollError, match=f"chmod 600 {path}"):
        read_key(path)


def test_a_key_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(CanrollError, match="No such file"):
        read_key(tmp_path / "none.key")
    with pytest.raises(CanrollError, match="Is a directory"):
        read_key(tmp_path)


def test_the_development_key_has_the_length_of_a_key():
    assert len(DEVELOPMENT_KEY) == KEY_BYTES


def test_a_file_too_large_for_a_key_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(documents, "MOST_BYTES", 1 << 20)
    with pytest.raises(CanrollError, match="larger than 1 MB"):
        read_key(file_of(tmp_path, "0" * ((1 << 20) + 1)))


def test_bytes_that_are_no_text_are_refused(tmp_path):
    path = file_of(tmp_path, "")
    path.write_bytes(b"\xff" * 32)
    with pytest.raises(CanrollError, match="not UTF-8"):
        read_key(path)
