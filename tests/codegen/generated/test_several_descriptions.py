"""A map on a network description of several files: what one file would give, and refusals."""

from dataclasses import replace

import pytest
from support import split_bus

from canroll.codegen.generated.bus_map import load
from canroll.codegen.run.bus_firmware import of_bus
from canroll.errors import CanrollError


def test_two_files_give_what_one_gives(tmp_path):
    files = split_bus.write(tmp_path)
    assert load(files, split_bus.MAP) == load(split_bus.OWN, split_bus.MAP)
    both, one = of_bus(files, split_bus.MAP), of_bus(split_bus.OWN, split_bus.MAP)
    assert both.slots == one.slots and both.sent == one.sent
    named = {n: t.replace("car.dbc and actuators.dbc", "own.dbc") for n, t in both.files.items()}
    assert named == one.files


def test_a_message_of_two_files_is_refused_where_it_is_used(tmp_path):
    car, actuators = split_bus.write(tmp_path)
    text = actuators.read_text(encoding="utf-8")
    twice = text + '\nBO_ 999 SUSP_02: 8 Dampers\n SG_ X : 0|8@1+ (1,0) [0|0] "" Dampers\n'
    actuators.write_text(twice, encoding="utf-8")
    with pytest.raises(CanrollError) as refused:
        load((car, actuators), split_bus.MAP)
    message = str(refused.value)
    assert f"SUSP_02 is in {car} and {actuators}: rename it in all but one" in message
    assert "[receive.suspension_rate]" in message and "\n" not in message


def test_a_message_of_two_files_that_is_not_used_is_none_of_the_maps_business(tmp_path):
    files = split_bus.write(tmp_path)
    for number, path in enumerate(files):
        text = path.read_text(encoding="utf-8")
        own = f'\nBO_ {900 + number} UNUSED: 8 Dampers\n SG_ X : 0|8@1+ (1,0) [0|0] "" Dampers\n'
        path.write_text(text + own, encoding="utf-8")
    assert load(files, split_bus.MAP) == load(split_bus.OWN, split_bus.MAP)


def test_one_identifier_in_two_files_is_refused(tmp_path):
    files = split_bus.write(tmp_path)
    text = files[1].read_text(encoding="utf-8").replace("BO_ 403 ", "BO_ 257 ")
    files[1].write_text(text, encoding="utf-8")
    with pytest.raises(CanrollError, match="GYRO_01 and ACT_01 have the identifier 0x101"):
        load(files, split_bus.MAP)


def test_one_identifier_that_the_map_gives_to_two_files_is_refused(tmp_path):
    files = split_bus.write(tmp_path)
    map_file = tmp_path / "own.toml"
    text = split_bus.MAP.read_text(encoding="utf-8")
    text = text.replace('message = "ACT_01"', 'message = "ACT_01"\nid = 257')
    map_file.write_text(text, encoding="utf-8")
    with pytest.raises(CanrollError, match="GYRO_01 and ACT_01 have the identifier 0x101"):
        load(files, map_file)


def test_a_message_that_cannot_be_read_is_named_with_its_file(tmp_path):
    files = split_bus.write(tmp_path)
    text = files[1].read_text(encoding="utf-8").replace("ROLL_CMD: 8", "ROLL_CMD:")
    files[1].write_text(text, encoding="utf-8")
    with pytest.raises(CanrollError, match=r"actuators\.dbc: ROLL_CMD cannot be read: line"):
        load(files, split_bus.MAP)


def test_a_warning_of_each_file_is_that_of_the_map(tmp_path):
    files = split_bus.write(tmp_path)
    for path in files:
        path.write_text(path.read_text(encoding="utf-8") + "\n?? junk ??\n", encoding="utf-8")
    bus = load(files, split_bus.MAP)
    assert [w.split(": ")[0] for w in bus.warnings] == [str(path) for path in files]
    assert replace(bus, warnings=()) == load(split_bus.OWN, split_bus.MAP)
