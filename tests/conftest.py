"""What all tests share: where nothing may be skipped, a skip fails the run."""

import gc
import os
import signal
import subprocess
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings
from support.forked import Forked

# the same examples on every machine, however slow it is
settings.register_profile("reproducible", derandomize=True, deadline=None, max_examples=60)
settings.register_profile("long", settings.get_profile("reproducible"), max_examples=400)
settings.load_profile("reproducible")

# a shell starts what it puts into the background with SIGINT ignored, and so would be every
# program that a test ends by it
signal.signal(signal.SIGINT, signal.default_int_handler)

subprocess.Popen = Forked  # type: ignore[misc]
NOT_CORE = [Path(__file__).parent / folder for folder in ("canroll/extensions", "tools")]
"""Nothing else needs what these test."""
REPORTER = pytest.StashKey[pytest.TerminalReporter]()

gc.disable()


def pytest_collection_finish() -> None:
    """What has been imported and collected stays; to look through it again and again takes long."""
    gc.freeze()
    gc.enable()


@pytest.fixture(autouse=True)
def scheduled_as_before() -> Iterator[None]:
    """A test that leaves a real-time priority behind would starve all later ones."""
    if not hasattr(os, "sched_getscheduler"):
        yield
        return
    before = os.sched_getscheduler(0)
    yield
    assert os.sched_getscheduler(0) == before, "the test has changed the scheduling of its process"


@pytest.fixture(autouse=True)
def no_terminal_around(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a test prints is as wide as in a pipe, whatever terminal the suite is started from."""
    monkeypatch.delenv("COLUMNS", raising=False)
    monkeypatch.delenv("LINES", raising=False)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Whether a folder is left to ``./test.sh --all``."""
    core = "not slow" in config.getoption("markexpr")
    return True if core and collection_path in NOT_CORE else None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """What takes a minute and more for one check is run where it is asked for: ``-m long``."""
    if "long" in config.getoption("markexpr"):
        return
    config.hook.pytest_deselected(items=[item for item in items if item.get_closest_marker("long")])
    items[:] = [item for item in items if not item.get_closest_marker("long")]


def not_allowed(reporter: pytest.TerminalReporter) -> list[pytest.TestReport]:
    """Skipped tests, but for those that need what no package has."""
    skipped: list[pytest.TestReport] = reporter.stats.get("skipped", [])
    # a module that is skipped whole has no marks
    return [report for report in skipped if "outside" not in getattr(report, "keywords", ())]


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    config.stash[REPORTER] = terminalreporter
    skipped = not_allowed(terminalreporter)
    if os.environ.get("CANROLL_NO_SKIP") and skipped:
        for report in skipped:
            terminalreporter.write_line(
                f"skipped where nothing may be: {report.nodeid}: {reason(report)}"
            )


def reason(report: pytest.TestReport) -> str:
    """Why a test is skipped."""
    cause = report.longrepr
    return str(cause[2] if isinstance(cause, tuple) else cause).removeprefix("Skipped: ")


def pytest_unconfigure(config: pytest.Config) -> None:
    """Say last what this machine or this tier leaves untested."""
    reporter = config.stash.get(REPORTER, None)
    if reporter is None:
        return
    counted = Counter(map(reason, reporter.stats.get("skipped", [])))
    parts = [f"{count} {why}" for why, count in counted.most_common()]
    if "not slow" in config.getoption("markexpr"):
        parts.append("what ./test.sh --all adds")
    if parts:
        reporter.write_line(f"not tested: {'; '.join(parts)}")


def pytest_sessionfinish(session: pytest.Session) -> None:
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if os.environ.get("CANROLL_NO_SKIP") and reporter and not_allowed(reporter):
        session.exitstatus = 1
