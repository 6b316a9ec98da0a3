from importlib.metadata import EntryPoint

import pytest

from canroll import registry
from canroll.errors import UnknownNameError
from canroll.registry import Registry


@pytest.fixture
def numbers(monkeypatch):
    offered = [
        EntryPoint("tau", "math:tau", "canroll.numbers"),
        EntryPoint("pi", "math:e", "canroll.numbers"),
    ]
    points = {"canroll.numbers": offered}
    monkeypatch.setattr(registry, "entry_points", lambda group: points.get(group, []))
    return Registry("number", "canroll.numbers", {"pi": "math:pi", "broken": "no_such_module:x"})


def test_what_is_built_in_is_loaded_when_it_is_asked_for(numbers):
    assert "broken" in numbers
    assert list(numbers) == ["pi", "broken", "tau"]
    with pytest.raises(ModuleNotFoundError):
        numbers["broken"]


def test_a_package_offers_more_but_replaces_nothing(numbers):
    assert numbers["tau"] == pytest.approx(6.283, abs=1e-3)
    assert numbers["pi"] == pytest.approx(3.142, abs=1e-3)


def test_things_are_added_and_taken_out(numbers):
    numbers["two"] = 2.0
    assert numbers["two"] == 2.0
    assert len(numbers) == 4
    del numbers["two"]
    assert "two" not in numbers


def test_an_unknown_name_suggests_the_nearest(numbers):
    with pytest.raises(UnknownNameError, match="unknown number 'taw': did you mean 'tau'"):
        numbers["taw"]


def test_it_is_a_mapping(numbers):
    assert numbers.get("taw") is None
    assert dict(zip(numbers, range(3), strict=True)) == {"pi": 0, "broken": 1, "tau": 2}


def test_a_file_of_a_known_suffix_is_read_and_never_listed():
    texts = Registry[str]("text", "canroll.texts", {}, files={".txt": "builtins:str"})
    assert "some.txt" in texts
    assert "some.TXT#part" in texts
    assert "some.csv" not in texts
    assert texts["some.txt#part"] == "some.txt#part"
    assert list(texts) == []
    assert texts.origin("some.txt").who == "file some.txt"
