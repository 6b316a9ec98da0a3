"""Rows of plain values by column: how a study gives its result to Python."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

from canroll.errors import UnknownNameError, optional

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True, slots=True)
class Table:
    """A table with named columns.

    Attributes:
        rows: values by the name of their column; every row has the columns of the first.
    """

    rows: Sequence[Mapping[str, Any]]

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(self.rows[0]) if self.rows else ()

    def column(self, name: str) -> list[Any]:
        """Return the values of a column.

        Raises:
            UnknownNameError: no such column.
        """
        if name not in self.columns:
            raise UnknownNameError("column", name, self.columns)
        return [row[name] for row in self.rows]

    def to_pandas(self) -> "pandas.DataFrame":
        """Return the table as a data frame.

        Raises:
            MissingExtraError: pandas is not installed.
        """
        pandas = optional("pandas", "to_pandas()", "notebook")
        return pandas.DataFrame(list(self.rows), columns=list(self.columns))

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator[Mapping[str, Any]]:
        return iter(self.rows)

    def __getitem__(self, place: int) -> Mapping[str, Any]:
        return self.rows[place]

    def _repr_html_(self) -> str:
        """The table, for a notebook."""
        head = "".join(f"<th>{escape(name)}</th>" for name in self.columns)
        rows = "".join(
            "<tr>" + "".join(f"<td>{escape(_text(value))}</td>" for value in row.values()) + "</tr>"
            for row in self.rows
        )
        return f"<table><tr>{head}</tr>{rows}</table>"


def _text(value: Any) -> str:  # noqa: ANN401
    return f"{value:.4g}" if isinstance(value, float) else str(value)
