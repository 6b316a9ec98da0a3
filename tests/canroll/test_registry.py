from importlib.metadata import EntryPoint

import pytest

from canroll import registry
from canroll.errors import CanrollError, UnknownNameError
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


class _Distribution:
    def __init__(self, name):
        self.name, self.version = name, "1.0"


def _offer(monkeypatch, *owners):
    points = [EntryPoint("tau", f"math:{what}", "canroll.numbers") for _, what in owners]
    for point, (owner, _) in zip(points, owners, strict=True):
        vars(point).update(dist=_Distribution(owner))
    monkeypatch.setattr(
        registry, "entry_points", lambda group: points if group == "canroll.numbers" else []
    )
    return Registry("number", "canroll.numbers", {})


def test_what_canroll_offers_is_not_replaced_and_two_packages_are_refused(monkeypatch):
    assert _offer(monkeypatch, ("other", "e"), ("canroll", "tau"))["tau"] == pytest.approx(
        6.283, 1e-3
    )
    assert _offer(monkeypatch, ("canroll", "tau"), ("other", "e"))["tau"] == pytest.approx(
        6.283, 1e-3
    )
    with pytest.raises(
        CanrollError, match=r"'tau' is offered by one 1\.0 and two 1\.0: remove one"
    ):
        _offer(monkeypatch, ("one", "e"), ("two", "pi"))["tau"]


def test_an_extension_that_was_deleted_offers_nothing_a_package_that_is_broken_says_so(monkeypatch):
    gone = [EntryPoint("tau", "no_such_module:tau", "canroll.numbers")]
    monkeypatch.setattr(
        registry, "entry_points", lambda group: gone if group == "canroll.numbers" else []
    )
    vars(gone[0]).update(dist=_Distribution("canroll"))
    assert list(Registry("number", "canroll.numbers", {})) == []
    vars(gone[0]).update(dist=_Distribution("other"))
    with pytest.raises(CanrollError, match=r"number 'tau' of other 1\.0: ModuleNotFoundError"):
        Registry("number", "canroll.numbers", {})["tau"]


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
