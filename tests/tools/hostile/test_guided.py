"""Fuzzing guided by coverage: bounded, and that it finds what random damage does not."""

import random
import sys
import time
from collections import Counter
from importlib.util import find_spec
from pathlib import Path

import pytest

from tools.hostile import files, formats, guided

if find_spec("atheris") is None:
    pytest.skip("needs atheris: pip install 'canroll[judges]'", allow_module_level=True)

pytestmark = pytest.mark.slow

INPUTS = 200


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """Good files of the formats that need no run of two programs."""
    folder = tmp_path_factory.mktemp("guided") / "good"
    formats.make_undriven(folder)
    return folder


def fuzzed(form, good, keep, inputs=INPUTS, seed=1):
    return guided.fuzz(
        guided.Task(form=form, good=good, inputs=inputs, seed=seed, keep=keep / "kept")
    )


def planted(path):
    """Fail behind a chain of comparisons, each of which one byte of sixteen passes."""
    a, b, c = (byte >> 4 for byte in path.read_bytes()[:3].ljust(3, b"\0"))
    if a == 8 and b == 3 and c == 13:
        raise KeyError("planted")


def ended(path):
    """End the process, as compiled code may."""
    if len(path.read_bytes()) > 100:
        import ctypes

        ctypes.string_at(0)


def waiting(path):
    """Take longer than is allowed for some inputs."""
    if len(path.read_bytes()) > 100:
        time.sleep(10)


@pytest.mark.parametrize("name", ["faults/faults.toml", "secured/memory.json", "gains/gains.npz"])
def test_no_input_passes_a_reader(name, good, tmp_path):
    (form,) = (form for form in formats.FORMATS if form.name == name)
    if remedy := formats.lacking(form):
        pytest.skip(remedy)
    found = fuzzed(form, good, tmp_path)
    assert found.failures == {}
    assert found.counts["failed"] == 0
    assert found.counts["refused"] > INPUTS // 2
    assert sum(found.counts.values()) == pytest.approx(INPUTS, abs=2)
    assert found.edges[1] > found.edges[0] > 0
    assert found.features[1] > found.features[0] > 0
    assert not (tmp_path / "kept").exists()


def test_the_same_seed_gives_the_same_inputs(good, tmp_path):
    (form,) = (form for form in formats.FORMATS if form.name == "faults/faults.toml")
    first, second = (fuzzed(form, good, tmp_path, 200) for _ in range(2))
    assert first.counts == second.counts
    assert fuzzed(form, good, tmp_path, 200, seed=2).features != first.features


@pytest.mark.long
def test_guidance_finds_what_random_damage_does_not(tmp_path):
    form = formats.Format("word", "word.bin", planted)
    (tmp_path / "good" / "word").mkdir(parents=True)
    start, inputs, source = b"word", 10_000, random.Random(1)
    (tmp_path / "good" / form.name).write_bytes(start)
    outcomes, path = Counter(), tmp_path / form.file
    for _ in range(inputs):
        path.write_bytes(formats.damaged(start, source))
        outcomes[files.attempt(form, path, Counter())] += 1
    assert outcomes == {"read": inputs}
    found = fuzzed(form, tmp_path / "good", tmp_path, inputs)
    ((place, kept),) = found.failures.items()
    assert place.startswith(f"word/word.bin: KeyError at {__file__}:")
    assert Path(kept).read_bytes()[0] >> 4 == 8


def test_a_process_that_ends_is_a_failure_with_its_place(good, tmp_path):
    found = fuzzed(formats.Format("signal", "signal.csv", ended), good, tmp_path, 3000)
    ((place, kept),) = found.failures.items()
    assert place.startswith("signal/signal.csv: SIGSEGV at ")
    assert __file__ in place or "ctypes" in place
    assert len(Path(kept).read_bytes()) > 100
    assert found.counts["failed"] == 1


def test_what_takes_too_long_is_a_failure(good, tmp_path, monkeypatch):
    monkeypatch.setattr(files, "SECONDS", 1)
    found = fuzzed(formats.Format("signal", "signal.csv", waiting), good, tmp_path, 8)
    assert found.failures
    assert all(": TimeoutError at " in place for place in found.failures)


def strict(path):
    """Take nothing but what has a fault."""
    if b"[[" not in path.read_bytes():
        raise TypeError("without a fault")


def test_a_failure_is_printed_with_its_place_and_ends_it_with_exit_code_1(
    tmp_path, monkeypatch, capsys
):
    form = formats.Format("faults", "faults.toml", strict)
    monkeypatch.setattr(guided, "FORMATS", (form,))
    monkeypatch.setattr(guided, "make", formats.make_undriven)
    arguments = ["guided", "--inputs", "100", "--keep", str(tmp_path / "kept")]
    monkeypatch.setattr(sys, "argv", arguments)
    assert guided.main() == 1
    said = capsys.readouterr()
    assert said.err == ""
    header, one, total, failure = said.out.splitlines()
    assert header.split() == ["format", "inputs", *guided.OUTCOMES, "edges", "features"]
    assert one.split()[:2] == ["faults/faults.toml", "100"]
    assert total.split()[0] == "all"
    place, _, kept = failure.partition(": kept as ")
    assert place.startswith(f"faults/faults.toml: TypeError at {__file__}:")
    assert b"[[" not in Path(kept).read_bytes()
