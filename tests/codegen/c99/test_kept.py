"""A translation is made once; another firmware, bus or stage, or a damaged file, makes it anew."""

import pytest

from canroll import build_cache
from canroll.codegen.c99 import emit, kept
from canroll.codegen.run.bus_firmware import built_in, with_services


@pytest.fixture
def makes(monkeypatch, tmp_path):
    """A translation that counts how often it is made, with a cache of its own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    made = []

    def make():
        made.append(None)
        return {"a.c": "int a;\n", "ä.h": "/* π */\n"}

    return make, made


def test_it_is_made_once(makes):
    make, made = makes
    first = kept.translation(["a bus"], make)
    assert kept.translation(["a bus"], make) == first
    assert len(made) == 1
    kept.translation(["another bus"], make)
    assert len(made) == 2


def test_another_firmware_or_translator_makes_it_anew(makes, monkeypatch):
    make, made = makes
    kept.translation([], make)
    monkeypatch.setattr(build_cache, "sources", lambda *folders: b"changed")
    kept.translation([], make)
    assert len(made) == 2


def test_an_error_is_raised_each_time(makes):
    def refuse():
        raise ValueError("outside the subset")

    for _ in range(2):
        with pytest.raises(ValueError, match="outside"):
            kept.translation([], refuse)


def test_what_is_kept_is_what_is_translated():
    assert emit.firmware() == emit.emit()


def test_a_text_is_kept_by_its_subject_and_firmware(makes):
    _, made = makes

    def make():
        made.append(None)
        return {"text": f"text {len(made)}"}

    served = with_services(built_in(), ("xcp",))
    asked = [(built_in(), "page"), (built_in(), "table"), (served, "page")]
    texts = [firmware.kept(what, make)["text"] for firmware, what in asked]
    assert texts == ["text 1", "text 2", "text 3"]
    assert [firmware.kept(what, make)["text"] for firmware, what in asked] == texts
