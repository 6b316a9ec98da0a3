"""Faults as text and in files."""

import math

import pytest

from canroll.errors import CanrollError
from canroll.plant_sim.faults import Fault, parse, read_file
from canroll.plant_sim.faults.kinds import KINDS, PLACES, kinds_at
from canroll.plant_sim.faults.language import kind_of


def test_every_part_of_a_text_is_read():
    assert parse("Imu.RollRate=offset:-0.2@2:4:0.5,every=0.2,for=0.05") == (
        Fault(
            where="Imu.RollRate",
            kind="offset",
            value=-0.2,
            start=2.0,
            end=4.0,
            ramp=0.5,
            every=0.2,
            lasting=0.05,
        ),
    )


def test_a_ramp_may_have_no_end():
    (fault,) = parse("front=dead@2::0.5")
    assert (fault.start, fault.end, fault.ramp) == (2.0, math.inf, 0.5)


def test_several_faults_act_together():
    first, second = parse("Imu.RollRate=stuck@2 + rear_left=weak@3:4")
    assert (first.where, second.where) == ("Imu.RollRate", "rear_left")
    assert second.value == 0.5


def example(where, kind):
    """A fault of the kind that is allowed everywhere."""
    value = min(max(kind.low, 1.0), kind.high) if kind.value else 0.0
    return Fault(
        where=where,
        kind=kind.name,
        value=value,
        start=1.0 if kind.start else 0.0,
        ramp=0.25 if kind.ramps else 0.0,
    )


@pytest.mark.parametrize("where", PLACES)
def test_the_text_of_a_fault_is_read_as_that_fault(where):
    for kind in kinds_at(where):
        fault = example(where, kind)
        assert kind_of(fault) == kind
        assert parse(str(fault)) == (fault,)


def test_every_kind_has_a_place():
    assert {(kind.at, kind.name) for where in PLACES for kind in kinds_at(where)} == {
        (kind.at, kind.name) for kind in KINDS
    }


def test_a_file_says_the_same(tmp_path):
    path = tmp_path / "faults.toml"
    path.write_text(
        '[[fault]]\nwhere = "Imu.RollRate"\nkind = "stuck"\nstart = 2\nend = 4\n'
        '[[fault]]\nwhere = "front"\nkind = "weak"\nvalue = 0.3\nevery = 1.0\nfor = 0.1\n',
        encoding="utf-8",
    )
    texts = ("Imu.RollRate=stuck@2:4", "front=weak:0.3,every=1,for=0.1")
    assert read_file(path) == tuple(fault for text in texts for fault in parse(text))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('[[fault]]\nwhere = "Imu.RollRat"\nkind = "stuck"', "did you mean 'Imu.RollRate'?"),
        ('[[fault]]\nwhere = "Imu.RollRate"\nkind = "stuk"', "did you mean 'stuck'?"),
        ('[[fault]]\nwhere = "Imu.RollRate"\nkind = "stuck"\nstrat = 1', "did you mean 'start'?"),
        ('[[fault]]\nwhere = "Imu.RollRate"', "kind is missing"),
        ('[[fault]]\nwhere = 3\nkind = "stuck"', "where must be a name"),
        ('[[fault]]\nwhere = "front"\nkind = "weak"\nvalue = "much"', "value must be a number"),
        ('[[fault]]\nwhere = "front"\nkind = "weak"\nvalue = true', "value must be a number"),
        ("[[faults]]", "did you mean 'fault'?"),
        ("fault = 3", r"write each fault as a table \[\[fault\]\]"),
        ("", "no fault"),
        ("[[", "faults.toml"),
    ],
)
def test_what_is_wrong_in_a_file_is_named(text, expected, tmp_path):
    path = tmp_path / "faults.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(CanrollError, match=expected) as raised:
        read_file(path)
    assert "faults.toml" in str(raised.value)


def test_a_file_that_does_not_exist_is_named(tmp_path):
    with pytest.raises(CanrollError, match=r"none\.toml"):
        read_file(tmp_path / "none.toml")
