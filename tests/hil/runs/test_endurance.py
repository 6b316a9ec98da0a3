"""The memory of a run does not grow with its length, counted in bytes that Python allocates."""

import tracemalloc

import pytest

from hil.runs import experiment, saved_run
from hil.runs.logs import write_log
from plant_sim.world import spool

pytestmark = pytest.mark.slow

SHORT, LONG = 15.0, 30.0
"""Both longer than the blocks in which a run is recorded."""


@pytest.fixture(scope="module")
def planned():
    choices = {"plant": "roll1", "options": {"duration": LONG}}
    planned = experiment.plan("random_road", **choices)
    experiment.drive(*planned, enabled=True, duration=0.1)
    return planned


@pytest.fixture
def on_disk(monkeypatch):
    monkeypatch.setattr(spool, "IN_MEMORY", 0)


def peak_of(work):
    """Return the result of ``work`` and the most bytes that it had allocated at a time."""
    tracemalloc.start()
    try:
        return work(), tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def slope(work):
    """Return the further bytes per second of the longer run."""
    (_, short), (_, long) = (peak_of(lambda s=seconds: work(s)) for seconds in (SHORT, LONG))
    return (long - short) / (LONG - SHORT)


@pytest.mark.usefixtures("on_disk")
def test_a_tick_leaves_no_memory_behind(planned):
    """A second of 1000 steps and 100 ticks: the place of a few blocks, not their content."""
    assert slope(lambda seconds: experiment.drive(*planned, enabled=True, duration=seconds)) < 4000


@pytest.mark.usefixtures("on_disk")
def test_a_trace_is_written_in_blocks(planned, tmp_path):
    traces = {s: experiment.drive(*planned, enabled=False, duration=s) for s in (SHORT, LONG)}
    results = {s: experiment.assess(*planned, trace, None) for s, trace in traces.items()}
    assert slope(lambda s: write_log(tmp_path / f"{s}.asc", traces[s].frames)) < 40_000
    # one signal at a time, 8 bytes a step
    archived = slope(lambda s: saved_run.save_traces(tmp_path / f"{s}.npz", results[s]))
    assert archived < 3 * 8 * 1000
    judged = slope(lambda s: experiment.assess(*planned, traces[s], None))
    assert judged < 8 * 8 * 1000
