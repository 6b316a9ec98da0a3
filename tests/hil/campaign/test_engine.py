"""Where chunks are driven changes nothing, and nothing that dies loses or spoils one."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from support import chunks
from support.chunks import CHUNKS, fails, joined, opened, work

from canroll.errors import CanrollError
from hil.campaign import store
from hil.campaign.engine import Engine, engine, results

pytest.importorskip("pyarrow", reason="needs pyarrow: the extra campaign")

TESTS = str(Path(chunks.__file__).parents[1])


def tasks(*arguments):
    return [(store.chunk_name(n), work, (n, *arguments)) for n in range(CHUNKS)]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return joined(opened(tmp_path_factory.mktemp("whole")), Engine(None, 1))


def test_a_pool_changes_nothing(whole, tmp_path):
    with engine("local", 2) as pool:
        assert joined(opened(tmp_path), pool) == whole


def test_a_failing_chunk_is_one_error():
    with engine("local", 2) as pool, pytest.raises(CanrollError, match="chunk 3 cannot be"):
        list(results(pool, None, [("3", fails, (3,))]))


def test_work_is_taken_up_as_results_are_taken():
    """However many chunks there are, few are in work or waiting."""
    started = []

    def endless():
        number = 0
        while True:
            started.append(number)
            yield store.chunk_name(number), work, (number,)
            number += 1

    with engine("local", 2) as pool:
        for _, (name, _, _) in zip(range(10), results(pool, None, endless()), strict=False):
            assert len(started) <= int(name) + 5


def test_a_process_that_dies_leaves_whole_chunks(whole, tmp_path):
    """The campaign's process kills itself at chunk 5; what is there is whole, and is used."""
    script = (
        "import sys; sys.path.insert(0, sys.argv[1]); from support import chunks\n"
        "from pathlib import Path; kept = chunks.opened(Path(sys.argv[2]))\n"
        "chunks.joined(kept, chunks.Engine(None, 1), sys.argv[2] + '/grave')\n"
    )
    ended = subprocess.run(
        [sys.executable, "-c", script, TESTS, str(tmp_path)],
        check=False,
        capture_output=True,
    )
    assert ended.returncode == -signal.SIGKILL
    kept = opened(tmp_path, resume=True)
    there = sorted(path.stem for path in kept.folder.glob("*.parquet"))
    assert there == [store.chunk_name(n) for n in range(5)]
    again = [kept for _, _, kept in results(Engine(None, 1), kept, tasks())]
    assert again == [True] * 5 + [False] * 7
    assert joined(kept, Engine(None, 1)) == whole


def test_a_worker_of_the_pool_that_dies_is_one_line(tmp_path):
    with engine("local", 2) as pool, pytest.raises(CanrollError, match="continue with --resume"):
        joined(opened(tmp_path), pool, str(tmp_path / "grave"))
    assert (tmp_path / "grave").exists()


def test_a_file_being_written_is_no_chunk(tmp_path):
    kept = opened(tmp_path)
    part = kept.folder / ".0000000.parquet.1.part"
    part.write_bytes(b"PAR1")
    assert not kept.has("0000000")
    with pytest.raises(RuntimeError, match="full"), store._placed(kept.path("0000001")) as beside:
        beside.write_bytes(b"half")
        raise RuntimeError("full")
    assert list(kept.folder.glob("*.parquet")) == []


def test_two_machines_write_the_same_file_at_once(tmp_path):
    """Both have a process of the same number; each moves its own part."""
    path = tmp_path / "plan.json"
    with store._placed(path) as first, store._placed(path) as second:
        assert first != second
        first.write_bytes(b"plan")
        second.write_bytes(b"plan")
    assert path.read_bytes() == b"plan"
    assert list(tmp_path.iterdir()) == [path]


def test_chunks_of_another_campaign_are_refused(tmp_path):
    kept = opened(tmp_path)
    kept.write("0000000", work(0))
    other = store.Store(kept.folder, "1" * 64)
    with pytest.raises(CanrollError, match="belongs to another campaign"):
        other.read("0000000")


@pytest.mark.slow
def test_a_cluster_changes_nothing_though_a_worker_dies(whole, tmp_path, monkeypatch):
    """A worker is killed at chunk 5: the scheduler gives the chunk to another."""
    distributed = pytest.importorskip("distributed", reason="needs distributed: the extra cluster")
    monkeypatch.setenv("PYTHONPATH", TESTS)

    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
        ) as cluster,
        engine(cluster.scheduler_address, 1) as where,
    ):
        assert where.slots == 2
        grave = tmp_path / "grave"
        kept = opened(tmp_path)
        assert joined(kept, where, str(grave)) == whole
        assert grave.exists()


def test_no_scheduler_is_one_line(monkeypatch):
    pytest.importorskip("distributed", reason="needs distributed: the extra cluster")
    monkeypatch.setattr("hil.campaign.engine.PATIENCE_S", 0.2)
    with (
        pytest.raises(CanrollError, match="no Dask scheduler answers there"),
        engine("tcp://127.0.0.1:9", 1),
    ):
        pass


def test_ctrl_c_keeps_the_chunks_in_work(tmp_path):
    kept = opened(tmp_path)
    with engine("local", 2) as pool:
        running = results(pool, kept, tasks())
        next(running)
        time.sleep(0.2)
        with pytest.raises(KeyboardInterrupt):
            running.throw(KeyboardInterrupt)
    assert len(list(kept.folder.glob("*.parquet"))) >= 1
    assert joined(kept, Engine(None, 1))
