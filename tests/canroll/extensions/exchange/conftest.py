"""FMUs need FMPy and a C compiler."""

import pytest

from canroll.codegen.run import native

pytest.importorskip("fmpy", reason="fmpy is not installed: pip install 'canroll[fmi]'")
if native.compiler() is None:
    pytest.skip("no C compiler: apt-get install gcc", allow_module_level=True)
