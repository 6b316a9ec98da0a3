"""A metric is added in one place: a field of Metrics."""

import json
import subprocess
import sys

import pytest

FIELD = "    rollover: bool = metric"
ADDED = """\
    yaw_rate_max_deg_s: float = metric(
        "yaw rate max", "deg/s", 1, ("yaw_rate",), _degrees(_max)
    )
"""
PROGRAM = """
import importlib.util, sys
spec = importlib.util.find_spec("canroll.runs.metrics")
text = spec.loader.get_source("canroll.runs.metrics")
assert {field!r} in text
module = importlib.util.module_from_spec(spec)
sys.modules["canroll.runs.metrics"] = module
exec(compile(text.replace({field!r}, {added!r} + {field!r}), spec.origin, "exec"), vars(module))
from canroll.cli.main import main
sys.exit(main(sys.argv[1:]))
"""
J_TURN = ("j_turn", "--law", "lqr", "--plant", "roll1")


def canroll(*arguments):
    """Run the command with one more metric; return what it prints."""
    program = PROGRAM.format(field=FIELD, added=ADDED)
    ran = subprocess.run(
        [sys.executable, "-c", program, *arguments], stdout=subprocess.PIPE, text=True, check=True
    )
    return ran.stdout


@pytest.mark.long
def test_a_metric_added_in_one_place_is_everywhere(tmp_path):
    run = json.loads(canroll("run", *J_TURN, "--out", str(tmp_path), "--json"))
    values = [run[side]["yaw_rate_max_deg_s"] for side in ("passive", "controlled")]
    assert min(values) > 0.0
    (page,) = tmp_path.rglob("report.html")
    text = page.read_text(encoding="utf-8")
    assert "yaw rate max (deg/s)" in text and 'data-key="passive.yaw_rate_max_deg_s"' in text
    options = ("campaign", *J_TURN, "--runs", "2", "--jobs", "1")
    campaign = json.loads(canroll(*options, "--json", "--worst-by", "yaw_rate_max_deg_s"))
    draws = [draw["controlled_yaw_rate_max_deg_s"] for draw in campaign["worst"]]
    assert draws == sorted(draws, reverse=True) and min(draws) > 0.0
