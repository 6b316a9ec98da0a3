"""The examples of the documentation run as they stand there."""

import re
from pathlib import Path

import numpy as np
import pytest

DOCS = Path(__file__).parents[1] / "docs"
EXAMPLES = re.findall(
    r"^## (.+?)$.*?```python\n(.*?)```", (DOCS / "api.md").read_text(), re.S | re.M
)


@pytest.mark.parametrize(("title", "code"), EXAMPLES, ids=[title for title, _ in EXAMPLES])
def test_example(title, code, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    exec(compile(code, f"docs/api.md: {title}", "exec"), {})
    if "heavier" in code:
        names = (tmp_path / "heavier_van.csv").open().readline().strip().split(",")
        rows = np.loadtxt(tmp_path / "heavier_van.csv", delimiter=",", skiprows=1)
        assert names[0] == "time" and "roll" in names
        assert rows.shape[1] == len(names)
        assert np.allclose(np.diff(rows[:, 0]), 1e-3)


def test_there_are_six_examples():
    assert len(EXAMPLES) == 6
