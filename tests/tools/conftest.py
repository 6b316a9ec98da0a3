"""A folder for a small program of the subset."""

import pytest
from support.sample import Sample


@pytest.fixture
def sample(tmp_path):
    return Sample(tmp_path)
