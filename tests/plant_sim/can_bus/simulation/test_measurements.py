"""Frames of measurements by XCP on a modelled bus."""

from dataclasses import replace

import pytest

from canroll.cli import main
from canroll.errors import CanrollError
from canroll.plant_sim.can_bus import load_profile
from canroll.plant_sim.can_bus.bounds.delay_bounds import delay_bounds, message_paths
from canroll.plant_sim.can_bus.network.profiles import routed_messages

QUIET = load_profile("500k", None, None)


def test_they_come_besides_the_load_and_below_all_others():
    plain = routed_messages(QUIET)
    more = routed_messages(replace(QUIET, measured=(6, 10.0)))
    assert more[: len(plain)] == plain
    added = [routed.message for routed in more[len(plain) :]]
    assert [m.name for m in added] == [f"XcpMeasurement{k}" for k in range(1, 7)]
    assert {m.period_ns for m in added} == {10e6} and {m.length for m in added} == {8}
    assert len({m.ident for m in more for m in [m.message]}) == len(more)
    assert min(m.ident for m in added) > max(
        routed.message.ident for routed in plain if not routed.message.name.startswith("Backgr")
    )


def test_the_bounds_count_them():
    # the loop's frames wait for one lower frame at most, which is there without them too
    loop = [delay_bounds(replace(QUIET, measured=(n, 10.0))).tau_max for n in (0, 4)]
    assert loop[1] == pytest.approx(loop[0])
    # where nothing else is below ours, the last of ours has to wait for one of them
    above = replace(QUIET, above=1.0)
    last = [
        message_paths(replace(above, measured=(n, 10.0)))["RollControlDiagnostics"].greatest
        for n in (0, 1)
    ]
    assert last[1] > last[0] + 200e-6


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["traffic.toml", "--xcp", "2"], "--xcp requires a network"),
        (["500k", "--xcp", "40"], "--xcp must be 0 to 32 frames"),
    ],
)
def test_misplaced_options_are_refused(capsys, arguments, words):
    assert main.main(["bus", *arguments]) == 2
    assert words in capsys.readouterr().err


def test_no_identifier_left_is_an_error():
    with pytest.raises(CanrollError, match="identifiers are free"):
        routed_messages(replace(QUIET, measured=(2000, 10.0)))
