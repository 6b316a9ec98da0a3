"""The tables of AES are what their generator makes."""

import pytest

from canroll.codegen.generated import aes_tables


@pytest.mark.drift
def test_the_tables_are_up_to_date():
    assert aes_tables.PATH.read_text(encoding="utf-8") == aes_tables.generate(), (
        "python -m canroll.codegen.generated.aes_tables"
    )
