"""Rooms inside the firmware: a module is found by its own name, however it is imported."""

import pytest

from canroll.codegen.c99 import emit
from canroll.codegen.subset.parse import load
from canroll.codegen.subset.program import SubsetError, source_files
from canroll.errors import CanrollError

INNER = '''"""Doubles."""

from canroll.firmware.subset import i32

SHIFT = 1


def doubled(a: i32) -> i32:
    """Return twice ``a``, of a small one."""
    return (a & 255) << SHIFT
'''
ENTRY = '''"""Entry."""

{how}
from canroll.firmware.subset import i32


def init(a: i32) -> i32:
    """Return twice ``a``."""
    return {call}(a)
'''


def firmware(folder, how, call):
    (folder / "ecu.py").write_text(ENTRY.format(how=how, call=call))
    (folder / "room").mkdir()
    (folder / "room" / "__init__.py").touch()
    (folder / "room" / "inner.py").write_text(INNER)
    return folder


@pytest.mark.parametrize(
    ("how", "call"),
    [
        ("from canroll.firmware.room.inner import doubled", "doubled"),
        ("from canroll.firmware.room import inner", "inner.doubled"),
    ],
)
def test_a_module_in_a_room_is_translated(tmp_path, how, call):
    folder = firmware(tmp_path, how, call)
    assert [path.name for path in source_files(folder)] == ["ecu.py", "inner.py"]
    files = emit.emit(folder=folder)
    assert "canroll_inner_doubled(a)" in files["canroll_ecu.c"]
    assert '#include "canroll_inner.h"' in files["canroll_ecu.c"]
    assert "canroll_inner_doubled" in files["canroll_inner.c"]


def test_two_modules_of_one_name_are_refused(tmp_path):
    folder = firmware(tmp_path, "from canroll.firmware.room import inner", "inner.doubled")
    (folder / "other").mkdir()
    (folder / "other" / "inner.py").write_text(INNER)
    with pytest.raises(CanrollError, match=r"other/inner\.py and .*room/inner\.py: .*unique"):
        load(folder=folder)


def test_a_rule_broken_in_a_room_names_its_file(tmp_path):
    folder = firmware(tmp_path, "from canroll.firmware.room import inner", "inner.doubled")
    (folder / "room" / "inner.py").write_text(INNER + "\n\nwhile True:\n    pass\n")
    with pytest.raises(SubsetError, match=r"room/inner\.py:13: "):
        load(folder=folder)
