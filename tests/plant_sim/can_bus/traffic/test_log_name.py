"""A log as a bus by name: file, channel and bit rates."""

from pathlib import Path

import pytest

from canroll.plant_sim.buses import BUSES
from canroll.plant_sim.can_bus.traffic.log_name import LogName, log_name


@pytest.mark.parametrize(
    ("file", "rest", "says"),
    [
        ("a/x.blf", "", (None, None, None)),
        ("a/x.blf", "#1", ("1", None, None)),
        ("a/x.blf", "@500000", (None, 500_000, None)),
        ("a/x.blf", "@500000/2000000", (None, 500_000, 2_000_000)),
        ("a/x.blf", "#can0@250000", ("can0", 250_000, None)),
        ("a/x.blf", "@250000#can0", ("can0", 250_000, None)),
        ("a@5/x.log.gz", "@250000", (None, 250_000, None)),
        ("a@5/x.log.gz", "", (None, None, None)),
    ],
)
def test_what_a_name_says(file, rest, says):
    assert log_name(file + rest) == LogName(Path(file), *says)
    assert file + rest in BUSES


@pytest.mark.parametrize("text", ["x.dbc", "x.toml@500000", "500k", "x.gz", "x.txt.gz"])
def test_other_names_are_none_of_a_log(text):
    assert log_name(text) is None
