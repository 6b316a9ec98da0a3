"""What a world records, as blocks of signals."""

import numpy as np
import pytest

from canroll.plant_sim.world import recording


@pytest.mark.parametrize("names", [recording.NAMES, ("roll", "time", "x"), ("envelope",), ()])
def test_a_block_has_the_columns_of_its_signals(names):
    rows = np.random.default_rng(0).normal(size=(37, recording.N_COLUMNS))
    times = np.arange(37) * 1e-3
    block = recording.signal_block(rows, times, names)
    expected = [times if name == "time" else rows[:, recording.SIGNALS[name]] for name in names]
    assert block.shape == (len(names), 37)
    assert all(map(np.array_equal, block, expected))


def test_a_block_of_an_unknown_signal_is_refused():
    with pytest.raises(KeyError, match="rol"):
        recording.signal_block(np.zeros((1, recording.N_COLUMNS)), np.zeros(1), ("rol",))
