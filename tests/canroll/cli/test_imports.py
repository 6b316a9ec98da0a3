"""A command imports what it needs: counts of modules, which are the same on every machine."""

import json
import subprocess
import sys

import pytest

from canroll.cli.main import main

LOADED = """
import json, sys
from canroll.cli.main import main
try:
    code = main(sys.argv[1:])
except SystemExit as ended:
    code = ended.code
print(json.dumps([code, sorted(sys.modules)]))
"""


def loaded(*words):
    """Return the modules that a command has imported at its end."""
    done = subprocess.run(
        [sys.executable, "-c", LOADED, *words],
        capture_output=True,
        text=True,
        timeout=1800,
        check=True,
    )
    code, modules = json.loads(done.stdout.splitlines()[-1])
    assert code == 0, done.stderr
    return set(modules)


def ours(modules):
    return [name for name in modules if name.split(".")[0] == "canroll"]


LISTS = ("laws", "vehicles", "scenarios", "buses", "bodies")
NUMBERS = {"numba", "scipy", "cvxpy", "clarabel", "matplotlib"}


@pytest.mark.parametrize(
    ("words", "never", "most"),
    [
        (["--help"], {*NUMBERS, "numpy", "can", "rich", "canroll.setup"}, 10),
        *((["list", kind], {*NUMBERS, "can", "rich"}, 70) for kind in LISTS),
        (["prove", "--help"], {*NUMBERS, "numpy", "can", "rich"}, 60),
        (
            ["bus", "500k", "--simulate", "0"],
            {
                *("cvxpy", "clarabel", "matplotlib", "jinja2", "elftools", "asammdf"),
                *("scipy.signal", "scipy.stats", "scipy.optimize", "scipy.special"),
                *(
                    "canroll.runs.metrics",
                    "canroll.plant_sim.nodes",
                    "canroll.plant_sim.world",
                    "canroll.gain_gen.design",
                ),
                *(
                    "canroll.plant_sim.can_bus.servers.socketcand",
                    "canroll.codegen.c99",
                    "canroll.codegen.subset",
                ),
            },
            170,
        ),
    ],
    ids=lambda words: " ".join(words) if isinstance(words, list) else "",
)
def test_a_light_command_imports_little(words, never, most):
    modules = loaded(*words)
    assert not never & modules
    assert len(ours(modules)) <= most


def test_a_run_imports_neither_solvers_nor_translators(tmp_path, capsys):
    design = tmp_path / "design"
    assert main(["design", "--law", "lqr", "--out", str(design)]) == 0
    words = ("run", "double_lane_change", "--duration", "0.5", "--out", str(tmp_path / "run"))
    words += ("--calibration", str(design / "calibration.toml"))
    loaded(*words)  # translates and compiles what is kept from then on
    modules = loaded(*words)
    assert not modules & {
        *("cvxpy", "clarabel", "matplotlib", "scipy.signal", "scipy.stats", "elftools", "asammdf"),
        *(
            "canroll.gain_gen.design",
            "canroll.gain_gen.analysis",
            "canroll.gain_gen.calibration.freeze",
            "canroll.firmware.ecu",
        ),
        *(
            "canroll.codegen.c99.emit",
            "canroll.codegen.proof",
            "canroll.codegen.subset",
            "canroll.codegen.run.unicorn",
        ),
        *(
            "canroll.plant_sim.can_bus.logs",
            "canroll.plant_sim.can_bus.traffic.inference",
            "canroll.hil.timing",
        ),
        *("canroll.extensions.exchange", "canroll.studies", "canroll.hil"),
    }
    assert len(ours(modules)) <= 242
