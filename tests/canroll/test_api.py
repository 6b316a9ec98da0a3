import re
import subprocess
import sys
import tomllib
from pathlib import Path

import canroll
from canroll.errors import EXTRAS


def test_every_public_name_is_there():
    for name in canroll.__all__:
        assert getattr(canroll, name).__name__.lower() in (name.lower(), "load")


def test_importing_loads_nothing_heavy():
    program = (
        "import sys, canroll;print(sorted({'numpy', 'numba', 'scipy', 'cvxpy'} & set(sys.modules)))"
    )
    process = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=1800, check=True
    )
    assert process.stdout.strip() == "[]"


def test_extras_are_those_of_the_project():
    text = (Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8")
    extras = tomllib.loads(text)["project"]["optional-dependencies"]
    # an extra that needs another one names that too
    named = {
        extra: {re.split("[><=]", p)[0] for p in listed if not p.startswith("canroll[")}
        for extra, listed in extras.items()
    }
    assert {extra: set(packages) for extra, packages in EXTRAS.items()} == {
        extra: packages for extra, packages in named.items() if extra != "dev"
    }
