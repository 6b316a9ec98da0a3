"""``canroll design``: which constant faults can be found with the signals that it receives."""

import json

from canroll.cli import design_view
from canroll.cli.main import main
from gain_gen.monitors.detectability import ConstantFault, Detectable, Limit


def test_sizes_have_their_units_and_what_is_never_found_says_so():
    seen = Detectable(
        ConstantFault("moment", "N·m", {}),
        (Limit("body", 1, 120.4, 1756.3),),
        float("inf"),
        ("rate",),
    )
    unseen = Detectable(ConstantFault("rate", "m/s", {}), (), float("inf"), ())
    table = design_view.detectability([seen, unseen])
    assert table.rows == [
        ("moment", "120 N·m", "1756 N·m", "never", "body", "rate"),
        ("rate", "never", "never", "never", "", ""),
    ]


def designed(tmp_path, capsys, *more):
    arguments = ["design", "--law", "lqr", "--actuator", "bars", "--out", str(tmp_path)]
    assert main([*arguments, *more]) == 0
    return capsys.readouterr().out


def test_the_table_is_of_the_signals_that_are_received(tmp_path, capsys):
    every = json.loads(designed(tmp_path, capsys, "--json"))["detectability"]
    names = [row["fault"] for row in every]
    assert "moment of the front axle" in names and "roll rate" in names
    assert all(row["straight"] <= row["slalom"] for row in every)
    few = json.loads(designed(tmp_path, capsys, "--json", "--no-watch-response"))["detectability"]
    assert [row["fault"] for row in few] == ["lateral acceleration"]


def test_it_is_printed_with_the_other_numbers(tmp_path, capsys):
    text = designed(tmp_path, capsys, "--verbose")
    assert design_view.DETECTABILITY in text
    assert "moment of the front axle" in text
