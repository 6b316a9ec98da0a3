"""Readers in compiled code that a damaged file can end run in a process of their own."""

import io
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


def arrays(program: str, path: Path) -> dict[str, NDArray[Any]]:
    """Return the arrays that a Python program makes of the file ``path``.

    Args:
        program: it finds the path in ``sys.argv[1]`` and writes an .npz to ``sys.stdout.buffer``.
        path: the file.

    Raises:
        ValueError: the program failed; the message is the last line of what it said, if any.
    """
    done = subprocess.run(
        [sys.executable, "-c", program, str(path)], capture_output=True, check=False
    )
    if done.returncode:
        said = done.stderr.decode("utf-8", "replace").strip().splitlines()
        raise ValueError(said[-1] if said and done.returncode > 0 else "the reader crashed")
    with np.load(io.BytesIO(done.stdout)) as stored:
        return dict(stored)
