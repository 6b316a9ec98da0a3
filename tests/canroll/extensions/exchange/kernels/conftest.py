"""Kernels compiled from their translation to C."""

import ctypes
import subprocess

import pytest

from canroll.extensions.exchange.kernels.translate import Translator


@pytest.fixture
def compiled(tmp_path):
    """Return the C function of a kernel of arrays of floats, and of a float at last."""

    def built(kernel, kinds, result=None):
        translator = Translator("test_")
        prototype = translator.entry(kernel, kinds, "run")
        (tmp_path / "kernels.h").write_text(translator.header([prototype]))
        (tmp_path / "kernels.c").write_text(translator.text())
        build = ["cc", "-O2", "-ffp-contract=off", "-shared", "-fPIC", "-o", "kernels.so"]
        subprocess.run([*build, "kernels.c", "-lm"], cwd=tmp_path, check=True)
        function = ctypes.CDLL(str(tmp_path / "kernels.so")).run
        pointers = [ctypes.POINTER(ctypes.c_double)] * (len(kinds) - 1)
        function.restype, function.argtypes = result, (*pointers, ctypes.c_double)
        return lambda *arrays: function(
            *(each.ctypes.data_as(pointers[0]) for each in arrays[:-1]), arrays[-1]
        )

    return built
