import subprocess
import sys

import canroll


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
