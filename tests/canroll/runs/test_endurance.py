"""The memory of a run does not grow with its length, counted in bytes that Python allocates."""

import tracemalloc

import pytest

from canroll.plant_sim.world import spool
from canroll.report import figure, picture, run_page, workbench
from canroll.runs import experiment, saved_run
from canroll.runs.logs import write_log

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
    """No table is kept in memory, and pieces are so short that every run has several."""
    monkeypatch.setattr(spool, "IN_MEMORY", 0)
    monkeypatch.setattr(spool, "PIECE", 4096)


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


@pytest.mark.long
@pytest.mark.usefixtures("on_disk")
def test_a_trace_is_written_in_blocks(planned, tmp_path):
    traces = {s: experiment.drive(*planned, enabled=False, duration=s) for s in (SHORT, LONG)}
    results = {s: experiment.assess(*planned, trace, None) for s, trace in traces.items()}
    assert slope(lambda s: write_log(tmp_path / f"{s}.asc", traces[s].frames)) < 40_000
    archived = slope(lambda s: saved_run.save_traces(tmp_path / f"{s}.npz", results[s]))
    assert archived < 8 * 1000
    judged = slope(lambda s: experiment.assess(*planned, traces[s], None))
    assert judged < 8 * 1000


@pytest.mark.long
@pytest.mark.usefixtures("on_disk")
def test_what_is_driven_judged_and_shown_of_a_run_does_not_grow_with_it(monkeypatch, tmp_path):
    """Driving, replay, judgement, picture and page: together the place of four signals.

    One is the steering that is replayed; the others are margin for blocks that fall unevenly.
    """
    monkeypatch.setattr(picture, "POINTS", 2000)
    monkeypatch.setitem(figure.POINTS_OF, "step", 500)
    monkeypatch.setitem(figure.POINTS_OF, "marks", 500)
    monkeypatch.setattr(run_page, "PICTURES", 200)
    monkeypatch.setattr(workbench, "INSTANTS_MAX", 200)
    monkeypatch.setattr(workbench, "FRAMES_MAX", 200)
    settings, controller = experiment.plan("random_road", options={"duration": LONG})

    def all_of(seconds):
        result = experiment.simulate(settings, controller, duration=seconds)
        assert result.replay is not None
        picture.plot(result).savefig(tmp_path / "run.png")
        return run_page.run_page(result)

    all_of(1.0)
    assert slope(all_of) < 4 * 8 * 1000
