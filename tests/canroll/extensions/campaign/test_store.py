"""Chunks of a campaign on disk."""

import numpy as np
import pytest

from canroll.errors import CanrollError
from canroll.extensions.campaign import store

pytest.importorskip("pyarrow", reason="needs pyarrow: the extra campaign")


def test_chunks_of_another_campaign_are_refused(tmp_path):
    kept = store.opened(tmp_path / "campaign", "0" * 64, {}, resume=False)
    kept.write("0000000", {"draw": np.arange(4)})
    other = store.Chunks(kept.folder, "1" * 64)
    with pytest.raises(CanrollError, match="belongs to another campaign"):
        other.read("0000000")
