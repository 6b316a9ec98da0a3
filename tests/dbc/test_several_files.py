"""One network description from several files."""

from pathlib import Path

import pytest

from canroll import dbc
from canroll.dbc.reader import network, paths_of
from canroll.errors import CanrollError

CAR = """VERSION ""
BU_: A B
BO_ 100 Motion: 8 A
 SG_ Rate : 0|16@1- (0.01,0) [0|0] "deg/s" B
BO_ 101 Other: 8 A
 SG_ Flag : 0|1@1+ (1,0) [0|1] "" B
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 10000;
BA_ "GenMsgCycleTime" BO_ 100 20;
"""
OTHER = """VERSION ""
BU_: C
BO_ 200 Valve: 8 C
 SG_ Current : 0|16@1+ (0.01,0) [0|0] "A" C
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 10000;
BA_DEF_ BO_ "E2EDataId" INT 0 65535;
BA_DEF_DEF_ "GenMsgCycleTime" 50;
BA_ "E2EDataId" BO_ 200 7;
"""


def write(folder, car=CAR, own=OTHER):
    paths = folder / "car.dbc", folder / "own.dbc"
    for path, text in zip(paths, (car, own), strict=True):
        path.write_text(text, encoding="utf-8")
    return paths


def test_the_messages_of_all_files_are_one_description(tmp_path):
    database, warnings = dbc.read(write(tmp_path))
    assert [m.name for m in database.messages] == ["Motion", "Other", "Valve"]
    assert database.get_message_by_name("Valve").frame_id == 200 and warnings == ()


def test_the_attributes_of_a_message_are_those_of_its_own_file(tmp_path):
    database, _ = dbc.read(write(tmp_path))
    valve, motion = map(database.get_message_by_name, ("Valve", "Motion"))
    assert dbc.attribute(valve, "GenMsgCycleTime") == 50 and dbc.data_id(valve) == 7
    assert motion.cycle_time == 20 and dbc.data_id(motion) == 0


def test_a_file_alone_is_what_it_was(tmp_path):
    car, _ = write(tmp_path)
    assert dbc.read(car)[0] is dbc.read((car,))[0]
    assert paths_of([car]) == paths_of(str(car)) == car
    assert paths_of(["a.dbc", "b.dbc"]) == (Path("a.dbc"), Path("b.dbc"))


def test_it_is_put_together_once(tmp_path):
    paths = write(tmp_path)
    assert dbc.read(paths)[0] is dbc.read(paths)[0]


def test_a_changed_file_is_read_again(tmp_path):
    paths = write(tmp_path)
    dbc.read(paths)
    paths[1].write_text(OTHER.replace("Valve", "Pump"), encoding="utf-8")
    assert dbc.read(paths)[0].messages[-1].name == "Pump"


def test_each_warning_names_its_file(tmp_path):
    paths = write(tmp_path, CAR + "?? junk ??\n", OTHER + '?? more "junk"\n')
    warnings = network(paths).warnings
    assert [w.split(": ")[0] for w in warnings] == [str(path) for path in paths]


def test_what_cannot_be_read_is_named_with_its_file(tmp_path):
    paths = write(tmp_path, own=OTHER.replace("BO_ 200 Valve: 8 C", "BO_ 200 Valve: C"))
    unread = network(paths).unread("Valve")
    assert unread.startswith(f"{paths[1]}: Valve cannot be read: line 3")
    assert network(paths).unread("Motion") == ""


def test_one_file_twice_is_refused(tmp_path):
    car, _ = write(tmp_path)
    with pytest.raises(CanrollError, match=r"car\.dbc: given twice"):
        network((car, car))


def test_the_file_that_cannot_be_read_is_named(tmp_path):
    car, own = write(tmp_path, own="nothing")
    with pytest.raises(CanrollError, match=r"own\.dbc: not a readable DBC"):
        network((car, own))
