"""The chunks of a campaign on disk: Parquet files, each whole or absent, and their table."""

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from canroll import documents
from canroll.cases.store import Store, placed
from canroll.errors import CanrollError, optional, reason, writing
from canroll.extensions.campaign.plan import Columns

if TYPE_CHECKING:
    import pyarrow

PLAN = "plan.json"
DIGEST = b"canroll.plan"
COMPRESSION = "zstd"


def arrow() -> Any:  # noqa: ANN401
    """Return pyarrow with its Parquet part.

    Raises:
        MissingExtraError: it is not installed.
    """
    optional("pyarrow.parquet", "a campaign's table", "campaign")
    return optional("pyarrow", "a campaign's table", "campaign")


@dataclass(frozen=True, slots=True)
class Chunks(Store[Columns]):
    """The chunks of one plan as Parquet files, with the plan's fingerprint in each."""

    suffix = ".parquet"

    def __post_init__(self) -> None:
        """Refuse to go on without pyarrow, before anything slow is done."""
        arrow()

    def read(self, name: str) -> Columns:
        """Return a chunk."""
        return self.columns(self.path(name))

    def columns(self, path: Path) -> Columns:
        """Return a file of this plan as columns; text as objects.

        Raises:
            CanrollError: it is damaged, or of another plan.
        """
        table = self.table(path)
        return {
            name: np.asarray(table.column(name).to_numpy(zero_copy_only=False))
            for name in table.column_names
        }

    def table(self, path: Path) -> "pyarrow.Table":
        """Return a file of this plan as a table.

        Raises:
            CanrollError: it is damaged, or of another plan.
        """
        pa = arrow()
        try:
            # without memory mapping: a file that shrinks would end the process by a signal
            table = pa.parquet.ParquetFile(path).read()
        except (OSError, pa.ArrowException) as error:
            raise CanrollError(
                f"{path}: not a chunk of a campaign ({reason(error)}): delete it and continue with "
                "--resume"
            ) from error
        if (table.schema.metadata or {}).get(DIGEST) != self.digest.encode():
            raise CanrollError(f"{path}: belongs to another campaign: choose another --out")
        return table

    def write(self, name: str, columns: Columns) -> None:
        """Write a chunk, whole or not at all."""
        pa = arrow()
        table = pa.table({key: pa.array(values) for key, values in columns.items()})
        with placed(self.path(name)) as part:
            pa.parquet.write_table(self._marked(table), part, compression=COMPRESSION)

    def join(self, names: Iterable[str], path: Path) -> None:
        """Write the chunks ``names`` one after the other as one file, whole or not at all."""
        pa = arrow()
        with placed(path) as part:
            writer = None
            for name in names:
                table = self.table(self.path(name))
                if writer is None:
                    writer = pa.parquet.ParquetWriter(part, table.schema, compression=COMPRESSION)
                writer.write_table(table)
            if writer is not None:
                writer.close()

    def _marked(self, table: Any) -> Any:  # noqa: ANN401
        return table.replace_schema_metadata({DIGEST: self.digest.encode()})


def opened(folder: Path, digest: str, description: dict[str, Any], *, resume: bool) -> Chunks:
    """Return the store in ``folder``, created if missing.

    Args:
        folder: folder of the chunks.
        digest: fingerprint of the plan.
        description: the plan as plain data.
        resume: whether to continue the campaign in the folder.

    Raises:
        CanrollError: the folder holds an unfinished campaign and ``resume`` is not given, another
            campaign, or cannot be written.
        MissingExtraError: pyarrow is not installed.
    """
    store = Chunks(folder, digest)
    plan = folder / PLAN
    kept = _kept(plan)
    with writing(f"to {folder}", "choose another --out"):
        folder.mkdir(parents=True, exist_ok=True)
        if kept is not None and not resume:
            for path in (*folder.glob("*.parquet"), *folder.glob(".*.part")):
                path.unlink()
            table_of(folder).unlink(missing_ok=True)
            plan.unlink()
            kept = None
        if kept is None:
            with placed(plan) as part:
                text = json.dumps({"digest": digest, **description}, indent=2, default=str)
                part.write_text(text + "\n", encoding="utf-8")
    if kept is not None and kept.get("digest") != digest:
        other = {"digest": digest, **json.loads(json.dumps(description, default=str))}
        differs = [key for key in other if key != "digest" and kept.get(key) != other[key]]
        raise CanrollError(
            f"{folder}: --resume continues the same campaign, this one differs in "
            f"{', '.join(differs) or 'its calibration'}: choose another --out"
        )
    return store


def unfinished(folder: Path) -> int | None:
    """Return how many chunks of an unfinished campaign the folder holds; None if it holds none."""
    if _kept(folder / PLAN) is None or table_of(folder).is_file():
        return None
    return len(list(folder.glob("*.parquet"))) or None


def table_of(folder: Path) -> Path:
    """Return the path of the whole table of the chunks in a folder."""
    return folder.parent / f"{folder.name}.parquet"


def _kept(plan: Path) -> dict[str, Any] | None:
    """Return the plan in a folder; None if there is none."""
    try:
        kept = documents.parse_json(documents.text(plan))
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise CanrollError(f"{plan}: not a campaign's plan ({reason(error)})") from error
    if not isinstance(kept, dict):
        raise CanrollError(f"{plan}: not a campaign's plan")
    return kept


def chunk_name(number: int) -> str:
    """Return the name of a chunk."""
    return f"{number:07d}"
