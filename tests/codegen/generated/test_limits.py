"""The checked-in ranges of the calibration are those of its field table."""

import pytest

from canroll.codegen.generated import limits


@pytest.mark.drift
def test_checked_in_module_is_what_the_field_table_says():
    assert limits.PATH.read_text(encoding="utf-8") == limits.emit()
