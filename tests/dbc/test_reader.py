"""DBCs that break the rules of their format: what is left of them, and what is said of it."""

import re
from pathlib import Path

import pytest

from canroll import dbc
from canroll.dbc.reader import network_file
from canroll.errors import CanrollError

HEAD = 'VERSION ""\nNS_ :\n\tCM_\n\tVAL_\nBS_:\nBU_: A B\n'
PLAIN = (
    HEAD
    + """BO_ 100 Motion: 8 A
 SG_ Rate : 0|16@1- (0.01,0) [0|0] "deg/s" B
 SG_ Speed : 16|16@1+ (0.01,0) [0|0] "km/h" B
BO_ 101 Other: 8 A
 SG_ Flag : 0|1@1+ (1,0) [0|1] "" B
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 10000;
BA_ "GenMsgCycleTime" BO_ 100 20;
VAL_ 101 Flag 0 "off" 1 "on";
"""
)


def read(folder, text, encoding="utf-8"):
    path = folder / "car.dbc"
    path.write_bytes(text.encode(encoding))
    database, warnings = dbc.read(path)
    return {message.name: message for message in database.messages}, " ".join(warnings)


def test_a_dbc_that_keeps_the_rules_has_no_warning(tmp_path):
    messages, warning = read(tmp_path, PLAIN)
    assert not warning and messages["Motion"].cycle_time == 20


@pytest.mark.parametrize(
    ("old", "new", "note"),
    [
        ("BA_DEF_", 'CM_ SG_ 100 "no name";\nBA_DEF_', 'line 12 (CM_ SG_ 100 "no name";)'),
        ("BA_DEF_", 'CM_ 100 "no kind";\nBA_DEF_', 'line 12 (CM_ 100 "no kind";)'),
        ("BA_DEF_", 'CM_ "no end"\nBA_DEF_', 'line 12 (CM_ "no end")'),
        ("BA_DEF_", 'CM_ BO_ 100 "no quote;\nBA_DEF_', 'line 12 (CM_ BO_ 100 "no quote;)'),
        ("BA_DEF_", "?? junk ??\nBA_DEF_", "line 12 (?? junk ??)"),
        ("BA_DEF_", 'VAL_ 100 Absent 0 "off";\nBA_DEF_', 'line 12 (VAL_ 100 Absent 0 "off";)'),
        ("BA_DEF_", 'VAL_ 99 Flag 0 "off";\nBA_DEF_', 'line 12 (VAL_ 99 Flag 0 "off";)'),
        ("BA_DEF_", 'BA_ "No" BO_ 100 1;\nBA_DEF_', 'line 12 (BA_ "No" BO_ 100 1;)'),
        ("BA_DEF_", "SIG_VALTYPE_ 9 X : 1;\nBA_DEF_", "line 12 (SIG_VALTYPE_ 9 X : 1;)"),
        ("BO_ 101", " SG_ Bad : 32|16 (1,0)\nBO_ 101", "line 10 (SG_ Bad : 32|16 (1,0))"),
        ("BO_ 101", " SG_ Bad\nBO_ 101", "line 10 (SG_ Bad)"),
        ("BO_ 101", " SG_ Bad : 8|8@1+ (1,0) \nBO_ 101", "line 10 (SG_ Bad : 8|8@1+ (1,0))"),
        ("BA_DEF_", "VAL_ 101 Flag\nBA_DEF_", "line 12 (VAL_ 101 Flag)"),
        ("BO_ 101", "BO_ 102: 8\n SG_ Flag : 0\nBO_ 101", "line 10 (BO_ 102: 8)"),
        ("BO_ 101", "BO_ 1075054137 Wide: 8 A\nBO_ 101", "line 10 (BO_ 1075054137 Wide: 8 A)"),
    ],
)
def test_what_cannot_be_read_is_left_out_alone(tmp_path, old, new, note):
    """Line 12 is the one behind the messages, 10 that behind the first."""
    messages, warning = read(tmp_path, PLAIN.replace(old, new, 1))
    assert f"car.dbc: read leniently: left out {note}" in warning
    assert warning.count("line") == 1
    assert [signal.name for signal in messages["Motion"].signals] == ["Rate", "Speed"]
    assert [signal.name for signal in messages["Other"].signals] == ["Flag"]
    assert messages["Motion"].cycle_time == 20
    assert messages["Other"].get_signal_by_name("Flag").choices[1] == "on"


def test_a_comment_may_look_like_a_statement(tmp_path):
    text = PLAIN + 'CM_ BO_ 100 "two\nBO_ 7 lines";\nCM_ 100 "no kind";\n'
    messages, warning = read(tmp_path, text)
    assert messages["Motion"].comment == "two\nBO_ 7 lines" and set(messages) == {"Motion", "Other"}
    assert warning.count("line") == 1


def test_a_missing_quote_takes_no_other_line_along(tmp_path):
    text = PLAIN.replace("BA_DEF_", 'CM_ BO_ 100 "one;\nCM_ BO_ 101 "kept";\nBA_DEF_', 1)
    messages, warning = read(tmp_path, text + 'CM_ BO_ 100 "two;\n')
    assert messages["Other"].comment == "kept" and messages["Motion"].cycle_time == 20
    assert warning.count("line") == 2 and "line 12" in warning and "line 17" in warning


def test_what_several_messages_have_is_theirs_by_their_signals(tmp_path):
    """An identifier may be that of two messages, or 0."""
    text = PLAIN.replace("101", "0").replace("BA_DEF_", 'BO_ 0 Third: 8 A\nCM_ 1 "";\nBA_DEF_', 1)
    text = text.replace("Third: 8 A\n", 'Third: 8 A\n SG_ Mode : 0|2@1+ (1,0) [0|3] "" B\n')
    messages, warning = read(tmp_path, text + 'VAL_ 0 Mode 1 "one";\n')
    assert warning.count("line") == 1
    assert messages["Other"].get_signal_by_name("Flag").choices[1] == "on"
    assert messages["Third"].get_signal_by_name("Mode").choices[1] == "one"


def test_all_that_is_left_out_is_named(tmp_path):
    text = PLAIN.replace("BO_ 101", " SG_ Bad : x\nBO_ 101") + 'CM_ 100 "a";\nCM_ 101 "b";\n'
    _, warning = read(tmp_path, text)
    assert "line 10" in warning and "line 16" in warning and "line 17" in warning


def test_signals_of_a_message_that_cannot_be_read_are_no_others(tmp_path):
    messages, _ = read(tmp_path, PLAIN.replace("BO_ 101 Other: 8 A", "BO_ 101 Other: A"))
    assert set(messages) == {"Motion"}
    assert [signal.name for signal in messages["Motion"].signals] == ["Rate", "Speed"]


def test_a_float_whose_type_cannot_be_read_is_left_out(tmp_path):
    """It would be taken for an integer."""
    text = f'{PLAIN}SIG_VALTYPE_ 100 Rate : 1 1;\nVAL_ 100 Rate 0 "zero";\n'
    messages, warning = read(tmp_path, text)
    assert [signal.name for signal in messages["Motion"].signals] == ["Speed"]
    assert "line 8 (SG_ Rate" in warning and "line 15 (SIG_VALTYPE_" in warning


def test_a_float_may_lack_its_colon(tmp_path):
    text = PLAIN.replace("0|16@1-", "32|32@1-") + 'SIG_VALTYPE_ 100 Rate 1;\nCM_ 100 "";\n'
    messages, _ = read(tmp_path, text)
    assert messages["Motion"].get_signal_by_name("Rate").is_float


def test_a_fraction_may_begin_with_its_point(tmp_path):
    messages, warning = read(tmp_path, PLAIN.replace("(0.01,0)", "(.01,-.5)"))
    rate = messages["Motion"].get_signal_by_name("Rate")
    assert (rate.scale, rate.offset) == (0.01, -0.5) and not warning


def test_a_name_may_begin_with_a_digit(tmp_path):
    text = PLAIN.replace("Other", "2017_5").replace("Flag", "0_FLAG")
    messages, warning = read(tmp_path, text)
    assert messages["_2017_5"].get_signal_by_name("_0_FLAG").choices[1] == "on"
    assert "named _2017_5 what is 2017_5, _0_FLAG what is 0_FLAG" in warning


def test_an_identifier_of_more_than_11_bits_is_that_of_an_extended_frame(tmp_path):
    messages, warning = read(tmp_path, PLAIN.replace("100", "317543591"))
    motion = messages["Motion"]
    assert motion.is_extended_frame and motion.frame_id == 317543591 and motion.cycle_time == 20
    assert f"taken as extended 0x{317543591:X} (Motion)" in warning


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252"])
def test_a_text_is_in_the_code_page_that_it_is_in(tmp_path, encoding):
    messages, _ = read(tmp_path, PLAIN.replace("deg/s", "°/s"), encoding)
    assert messages["Motion"].get_signal_by_name("Rate").unit == "°/s"


def test_two_code_pages_may_be_in_one_file(tmp_path):
    path = tmp_path / "car.dbc"
    text = PLAIN.replace("deg/s", "°/s").encode() + 'CM_ BO_ 100 "über";\n'.encode("cp1252")
    path.write_bytes(text)
    motion = dbc.read(path)[0].get_message_by_name("Motion")
    assert motion.comment == "über" and motion.get_signal_by_name("Rate").unit == "°/s"


def test_what_shares_an_identifier_or_a_name_is_named(tmp_path, caplog):
    text = PLAIN.replace("BA_DEF_", "BO_ 100 Again: 8 A\nBO_ 102 Other: 8 A\nBA_DEF_", 1)
    _, warning = read(tmp_path, text)
    assert "Motion and Again have the identifier 0x64, 2 messages are named Other" in warning
    assert not caplog.records  # cantools says it in a log


def test_overlapping_signals_are_named_by_message(tmp_path):
    text = PLAIN.replace("16|16@1+", "8|16@1+").replace("BA_DEF_", "BO_ 102 C: 1 A\nBA_DEF_", 1)
    text = text.replace("C: 1 A\n", 'C: 1 A\n SG_ Long : 0|16@1+ (1,0) [0|0] "" B\n')
    messages, warning = read(tmp_path, text)
    assert "overlapping in message Motion, The signal Long does not fit in message C" in warning
    assert len(messages["Motion"].signals) == 2


def test_the_lines_of_what_is_left_stay_where_they_are(tmp_path):
    path = tmp_path / "car.dbc"
    path.write_text(PLAIN.replace("BO_ 101", 'CM_ 100 "x"\n SG_ Y : x\nBO_ 101'))
    left = network_file(path).repaired.splitlines()
    for number, line in enumerate(path.read_text().splitlines()):
        assert left[number] in (line, "") or line.startswith(("VERSION", "NS_", "BS_", "\t"))
    assert any(line.startswith("BO_ 101") for line in left)


@pytest.mark.parametrize("text", ["", "no DBC at all\n", "BO_\n" * 1500 + "BO_ x\n" * 1500])
def test_what_is_no_dbc_is_refused_in_one_line(tmp_path, text):
    with pytest.raises(CanrollError, match=r"car\.dbc: not a readable DBC") as refused:
        read(tmp_path, text)
    assert "\n" not in str(refused.value)


def opendbc_files():
    opendbc = pytest.importorskip("opendbc", reason="needs the package opendbc (--no-deps)")
    from opendbc.dbc.generator import generator

    folder = Path(opendbc.__file__).parent / "dbc"
    files = {path.stem: path.read_bytes() for path in folder.glob("*.dbc")}
    return files | {name: text.encode() for name, text in generator.generate_all().items()}


@pytest.mark.long
def test_every_public_dbc_is_read(tmp_path):
    files = opendbc_files()
    assert len(files) > 90
    path = tmp_path / "car.dbc"
    for name, data in files.items():
        path.write_bytes(data)
        database, warnings = dbc.read(path)
        assert database.messages and len(warnings) <= 1, name
        idents = [int(ident) for ident in re.findall(rb"^\s*BO_\s+(\d+)", data, re.MULTILINE)]
        written = sum(ident & 0x7FFFFFFF < 1 << 29 for ident in idents)
        assert len(database.messages) == written, name
