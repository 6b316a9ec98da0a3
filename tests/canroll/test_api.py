import subprocess
import sys

import canroll
import hil


def test_every_public_name_is_there():
    for name in canroll.__all__:
        assert getattr(canroll, name).__name__.lower() in (name.lower(), "load")


def test_both_packages_offer_the_same_run():
    assert canroll.run is hil.run
    assert canroll.Result is hil.Result


def test_importing_loads_nothing_heavy():
    program = (
        "import sys, canroll, hil;"
        "print(sorted({'numpy', 'numba', 'scipy', 'cvxpy'} & set(sys.modules)))"
    )
    process = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True
    )
    assert process.stdout.strip() == "[]"
