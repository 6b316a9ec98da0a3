"""How the cases of a study are driven: by which processes, kept where, all or one of them."""

import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

from canroll.cases.engine import HERE, LOCAL, Engine, engine, results
from canroll.cases.identity import fingerprint
from canroll.cases.store import JsonRows
from canroll.errors import CanrollError, writing
from canroll.typing import Progress

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Execution:
    """How cases are driven; no row depends on it.

    Attributes:
        jobs: processes of this machine.
        scheduler: "local", or the address of a Dask scheduler.
        folder: keeps rows until all cases are driven; None: nowhere.
        resume: whether to continue with the rows in the folder.
        only: number of the only case to drive, from 0; None: all.
    """

    jobs: int = 1
    scheduler: str = LOCAL
    folder: Path | None = None
    resume: bool = False
    only: int | None = None

    @property
    def kept(self) -> int:
        """Number of rows in the folder."""
        return 0 if self.folder is None else len(list(self.folder.glob(f"*/*{JsonRows.suffix}")))

    @contextmanager
    def cases(self, progress: Progress | None = None) -> Iterator["Cases"]:
        """Yield what drives cases. The folder is removed when the body has succeeded.

        Raises:
            CanrollError: no process, an unfinished study in the folder, or no scheduler.
        """
        if self.jobs < 1:
            raise CanrollError(f"jobs={self.jobs}: must be at least 1")
        if self.kept and not self.resume:
            raise CanrollError(
                f"{self.folder} holds an unfinished study ({self.kept} cases): continue it with "
                "--resume, or choose another --out"
            )
        with engine(self.scheduler, self.jobs) as where:
            yield Cases(where, self, progress)
        if self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)


@dataclass(frozen=True, slots=True)
class Cases:
    """Drives the cases of a study; by default one after the other in this process.

    Attributes:
        engine: what drives them.
        execution: how.
        progress: called with a label and the share of its cases that are done.
        digest: fingerprint of the study whose rows are kept; empty: none are.
    """

    engine: Engine = HERE
    execution: Execution = Execution()
    progress: Progress | None = None
    digest: str = ""

    def report(self, label: str, share: float) -> None:
        """Report the share of an activity that is done."""
        if self.progress is not None:
            self.progress(label, share)

    def of(self, description: Mapping[str, Any]) -> "Cases":
        """Return what drives the cases of one study, which keeps its rows by themselves.

        ``description``: everything that decides the rows.
        """
        return replace(self, digest=fingerprint(description))

    def picked(self, cases: Sequence[T]) -> Sequence[T]:
        """Return all cases, or the only one to drive.

        Raises:
            CanrollError: there is no case of that number.
        """
        only = self.execution.only
        if only is None:
            return cases
        if not 0 <= only < len(cases):
            raise CanrollError(f"--only {only}: there are the cases 0 to {len(cases) - 1}")
        return cases[only : only + 1]

    def rows(
        self, label: str, work: Callable[..., T], arguments: Sequence[tuple[Any, ...]]
    ) -> Iterator[T]:
        """Yield the row of each case in their order.

        Args:
            label: the activity.
            work: function of a module that returns a row, of a type annotated there that
                :class:`canroll.cases.store.JsonRows` can keep.
            arguments: those of each case; one of many is sent to a process once where it is made
                by ``engine.common``.

        Raises:
            CanrollError: a case cannot be driven, or a row cannot be kept.
            KeyboardInterrupt: Ctrl-C; the cases in work are finished and kept.
        """
        store: JsonRows[T] | None = None
        if self.digest and self.execution.folder is not None:
            folder = self.execution.folder / self.digest[:16]
            with writing(f"to {folder}", "choose another --out"):
                folder.mkdir(parents=True, exist_ok=True)
            store = JsonRows(folder, self.digest, get_type_hints(work)["return"])
        tasks = (
            (f"{work.__name__}-{number:06d}", work, each) for number, each in enumerate(arguments)
        )
        for done, (_, row, _) in enumerate(results(self.engine, store, tasks), 1):
            self.report(label, done / len(arguments))
            yield row


IN_TURN = Cases()
