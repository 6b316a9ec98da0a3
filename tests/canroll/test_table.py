import sys

import pytest

from canroll.errors import MissingExtraError, UnknownNameError
from canroll.table import Table

ROWS = Table([{"law": "lqr", "roll": 1.25}, {"law": "a<b", "roll": 2.0}])


def test_a_table_is_read_by_row_and_column():
    assert len(ROWS) == 2
    assert ROWS[1]["law"] == "a<b"
    assert ROWS.column("roll") == [1.25, 2.0]
    assert [row["roll"] for row in ROWS] == [1.25, 2.0]
    with pytest.raises(UnknownNameError, match="did you mean 'roll'"):
        ROWS.column("rol")
    assert Table([]).columns == ()


def test_a_table_becomes_a_data_frame():
    frame = pytest.importorskip("pandas") and ROWS.to_pandas()
    assert list(frame["law"]) == ["lqr", "a<b"]
    assert Table([]).to_pandas().empty


def test_without_pandas_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(MissingExtraError, match="notebook"):
        ROWS.to_pandas()


def test_a_notebook_shows_a_table():
    assert "<td>a&lt;b</td><td>2</td>" in ROWS._repr_html_()
