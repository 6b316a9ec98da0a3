"""The data of a run in formats of others: MF4, Parquet, MCAP, xarray, pandas, a notebook."""

import json
from pathlib import Path

import numpy as np
import pytest

import canroll
from canroll import dbc
from canroll.cli.run import about
from canroll.errors import MissingExtraError
from canroll.report import signal_files
from canroll.report.signal_files import write_signals
from canroll.runs.logs import messages

ROOT = Path(__file__).parents[4]


@pytest.fixture(scope="module")
def result():
    return canroll.run("j_turn", law="lqr", duration=0.5)


@pytest.fixture(scope="module")
def extra(result):
    return about(result, result.controlled)


def test_mf4_says_what_the_run_was(tmp_path, result, extra):
    asammdf = pytest.importorskip("asammdf", reason="needs asammdf")
    path = write_signals(tmp_path / "run.mf4", result.controlled.signals, extra)
    with asammdf.MDF(path) as file:
        assert file.header.project == "canroll" and file.header.subject == "van_real"
        comment = file.header.comment
        assert "law: lqr" in comment and f"calibration id: 0x{result.record.id:08X}" in comment
        assert "seed: " in comment
        roll = file.get("roll")
        assert roll.unit == "rad"
        assert np.array_equal(roll.samples, result.controlled.signals["roll"])
        data, name, _ = file.extract_attachment(index=0)
        assert Path(name).name == dbc.PATH.name
        assert bytes(data) == dbc.PATH.read_bytes()


def test_parquet_has_units_and_settings(tmp_path, result, extra):
    parquet = pytest.importorskip("pyarrow.parquet", reason="needs pyarrow")
    path = write_signals(tmp_path / "run.parquet", result.controlled.signals, extra)
    table = parquet.read_table(path)
    assert table.column_names == list(result.controlled.signals)
    assert table.schema.field("roll").metadata == {b"unit": b"rad"}
    assert table.schema.metadata[b"canroll.law"] == b"lqr"
    for name, values in result.controlled.signals.items():
        assert np.array_equal(table[name].to_numpy(), values, equal_nan=True)
    again = write_signals(tmp_path / "again.parquet", result.controlled.signals, extra)
    assert again.read_bytes() == path.read_bytes()


def test_mcap_has_signals_frames_and_the_dbc(tmp_path, result, extra):
    reader = pytest.importorskip("mcap.reader", reason="needs mcap")
    trace = result.controlled
    path = write_signals(tmp_path / "run.mcap", trace.signals, extra)
    with path.open("rb") as file:
        opened = reader.make_reader(file)
        (attached,) = opened.iter_attachments()
        assert attached.name == dbc.PATH.name and attached.data == dbc.PATH.read_bytes()
        (told,) = opened.iter_metadata()
        assert told.metadata["law"] == "lqr"
        rows, frames = [], []
        for schema, channel, message in opened.iter_messages():
            assert schema.encoding == "jsonschema" and channel.message_encoding == "json"
            kept = rows if channel.topic == "/vehicle" else frames
            kept.append((message.log_time, json.loads(message.data)))
    assert [row["roll"] for _, row in rows] == trace.signals["roll"].tolist()
    assert [time for time, _ in rows] == np.round(1e9 * trace.signals["time"]).tolist()
    seen = list(messages(trace.frames))
    assert [(f["id"], f["data"]) for _, f in frames] == [
        (m.arbitration_id, bytes(m.data).hex()) for m in seen
    ]
    again = write_signals(tmp_path / "again.mcap", trace.signals, extra)
    assert again.read_bytes() == path.read_bytes()
    layout = json.loads((ROOT / "examples" / "foxglove" / "layout.json").read_text())
    plots = [panel for name, panel in layout["configById"].items() if name.startswith("Plot")]
    for plot in plots:
        for line in plot["paths"]:
            topic, _, name = line["value"].partition(".")
            assert topic == "/vehicle" and name in trace.signals


@pytest.mark.parametrize("suffix", [".parquet", ".mcap", ".mf4"])
def test_a_missing_package_names_its_extra(tmp_path, monkeypatch, suffix):
    monkeypatch.setattr(signal_files, "find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match=r"pip install 'canroll\[\w+\]'"):
        write_signals(tmp_path / f"run{suffix}", {"time": np.zeros(1)})


def test_xarray_and_pandas_have_both_runs(result):
    pytest.importorskip("xarray", reason="needs xarray")
    data = result.to_xarray()
    assert data["roll"].dims == ("run", "time") and data["roll"].attrs["units"] == "rad"
    for run, trace in (("passive", result.passive), ("controlled", result.controlled)):
        found = data["roll"].sel(run=run).dropna("time").to_numpy()
        assert np.array_equal(found, trace.signals["roll"])
    assert np.array_equal(
        data["ecu_mode"].sel(run="controlled").to_numpy(), result.controlled.ticks["mode"]
    )
    table = result.to_pandas()
    assert table.index.name == "time"
    assert np.array_equal(table["passive"]["roll"].dropna(), result.passive.signals["roll"])


def test_a_result_shows_itself(result):
    text = result._repr_html_()
    assert "j_turn, van_real, lqr" in text and result.verdict.replace("'", "&#x27;") in text
    assert f"<td>{result.controlled_metrics.roll_max_deg:.3g}</td>" in text


@pytest.mark.slow
def test_the_notebook_runs():
    nbformat = pytest.importorskip("nbformat", reason="needs nbformat")
    nbclient = pytest.importorskip("nbclient", reason="needs nbclient")
    pytest.importorskip("ipykernel", reason="needs ipykernel")
    notebook = nbformat.read(ROOT / "docs" / "notebook.ipynb", as_version=4)
    client = nbclient.NotebookClient(notebook, timeout=600, kernel_name="python3")
    client.execute(cwd=str(ROOT))
    outputs = {cell.id: cell.outputs for cell in notebook.cells if cell.cell_type == "code"}
    assert "text/html" in outputs["run"][-1].data
    assert outputs["xarray"][-1].data["text/plain"].startswith("('rad', 2, ")
