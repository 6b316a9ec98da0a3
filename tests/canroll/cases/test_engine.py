"""Where cases are driven changes no row, and nothing that dies loses or spoils one."""

import itertools
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from support import cases as fakes
from support.cases import COUNT, fails, refuses, study, work

from canroll.cases.engine import HERE, Engine, engine, results
from canroll.cases.execution import Cases, Execution
from canroll.cases.store import JsonRows, placed
from canroll.errors import CanrollError

TESTS = str(Path(fakes.__file__).parents[1])


@pytest.fixture(scope="module")
def whole():
    return study(Cases())


@pytest.fixture(scope="module")
def pool():
    with engine("local", 2) as two:
        yield two


def kept(folder):
    return sorted(path.stem for path in folder.glob("*/*.json"))


def test_rows_come_in_order_with_the_share_that_is_done(whole):
    said = []
    with Execution().cases(lambda *report: said.append(report)) as cases:
        assert study(cases) == whole
    assert said == [("cases", (n + 1) / COUNT) for n in range(COUNT)]
    assert [f"Pair(number={n}, text='first')" in row for n, row in enumerate(whole)] == [True] * 12


def test_two_processes_change_nothing(whole, pool):
    assert study(Cases(pool)) == whole


def test_one_case_alone_is_its_row(whole):
    assert study(Cases(execution=Execution(only=7))) == [whole[7]]
    with pytest.raises(CanrollError, match="--only 12: there are the cases 0 to 11"):
        study(Cases(execution=Execution(only=12)))


def test_a_failing_case_is_one_error(pool):
    with pytest.raises(CanrollError, match="case 3 is refused"):
        list(results(pool, None, [("3", refuses, (3,))]))
    with pytest.raises(CanrollError, match="unknown case '3'"):
        list(results(pool, None, [("3", fails, (3,))]))


def test_work_is_taken_up_as_results_are_taken(pool):
    """However many cases there are, few are in work or waiting."""
    started = []

    def endless():
        for number in itertools.count():
            started.append(number)
            yield str(number), work, (number,)

    for _, (name, _, _) in zip(range(10), results(pool, None, endless()), strict=False):
        assert len(started) <= int(name) + 5


def test_a_study_whose_process_dies_is_continued(whole, tmp_path):
    """It kills itself at case 5; what is there is whole, and is used; nothing is left over."""
    grave, folder = tmp_path / "grave", tmp_path / "cases"
    ended = subprocess.run(
        [sys.executable, fakes.__file__, str(folder), str(grave)],
        check=False,
        env={"PYTHONPATH": f"{TESTS}:{Path(TESTS).parent}"},
    )
    assert ended.returncode == -signal.SIGKILL
    assert kept(folder) == [f"work-{n:06d}" for n in range(5)]
    with (
        pytest.raises(CanrollError, match=r"unfinished study \(5 cases\): continue it with"),
        Execution(folder=folder).cases(),
    ):
        pass
    changed = next(folder.glob("*/work-000002.json"))
    row = json.loads(changed.read_text())
    changed.write_text(json.dumps(row | {"share": 17.0}))
    with Execution(folder=folder, resume=True, jobs=2).cases() as cases:
        again = study(cases)
    assert "share=17.0" in again[2]
    assert [*again[:2], *again[3:]] == [*whole[:2], *whole[3:]]
    assert not folder.exists()


def test_rows_of_another_study_are_not_used(whole, tmp_path):
    with Execution(folder=tmp_path / "cases").cases() as cases:
        list(cases.of({"study": "another"}).rows("cases", work, [(n, 9.0) for n in range(3)]))
        assert study(cases) == whole
        assert len(kept(tmp_path / "cases")) == 3 + COUNT


@pytest.mark.parametrize("text", ["", "{", "{}", '{"figures": 1, "share": 2, "pairs": 3}', "[1]"])
def test_a_damaged_row_is_one_line(text, tmp_path):
    rows = JsonRows(tmp_path, "", fakes.Row)
    rows.path("a").write_text(text)
    with pytest.raises(CanrollError, match=r"a\.json: not a row .* continue with --resume"):
        rows.read("a")


def test_a_worker_of_the_pool_that_dies_is_one_line(tmp_path):
    with (
        pytest.raises(CanrollError, match="continue with --resume"),
        Execution(2, folder=tmp_path / "cases").cases() as cases,
    ):
        study(cases, str(tmp_path / "grave"))
    assert (tmp_path / "grave").exists()


def test_a_file_being_written_is_no_row(tmp_path):
    rows = JsonRows(tmp_path, "", fakes.Row)
    with pytest.raises(RuntimeError, match="full"), placed(rows.path("1")) as beside:
        beside.write_bytes(b"half")
        raise RuntimeError("full")
    assert not rows.has("1")
    assert list(tmp_path.iterdir()) == []


def test_two_machines_write_the_same_file_at_once(tmp_path):
    """Both have a process of the same number; each moves its own part."""
    path = tmp_path / "plan.json"
    with placed(path) as first, placed(path) as second:
        assert first != second
        first.write_bytes(b"plan")
        second.write_bytes(b"plan")
    assert path.read_bytes() == b"plan"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.slow
def test_a_cluster_changes_nothing_though_a_worker_dies(whole, tmp_path, monkeypatch):
    """A worker is killed at case 5: the scheduler gives the case to another."""
    distributed = pytest.importorskip("distributed", reason="needs distributed: the extra cluster")
    monkeypatch.setenv("PYTHONPATH", TESTS)
    grave = tmp_path / "grave"
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
        ) as cluster,
        engine(cluster.scheduler_address, 1) as where,
    ):
        assert where.slots == 2
        assert study(Cases(where), str(grave)) == whole
    assert grave.exists()


def test_no_scheduler_is_one_line(monkeypatch):
    pytest.importorskip("distributed", reason="needs distributed: the extra cluster")
    monkeypatch.setattr("canroll.cases.engine.PATIENCE_S", 0.2)
    with (
        pytest.raises(CanrollError, match="no Dask scheduler answers there"),
        engine("tcp://127.0.0.1:9", 1),
    ):
        pass


def test_ctrl_c_keeps_the_cases_in_work(tmp_path):
    rows = JsonRows(tmp_path, "", fakes.Row)
    tasks = [(str(n), work, (n,)) for n in range(COUNT)]
    with engine("local", 2) as two:
        running = results(two, rows, tasks)
        next(running)
        time.sleep(0.2)
        with pytest.raises(KeyboardInterrupt):
            running.throw(KeyboardInterrupt)
    there = len(list(tmp_path.glob("*.json")))
    assert there >= 1
    again = [old for _, _, old in results(HERE, rows, tasks)]
    assert again == [True] * there + [False] * (COUNT - there)
    assert isinstance(HERE, Engine)
