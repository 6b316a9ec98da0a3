import numpy as np
import pytest
from scipy import signal

from canroll.plant_sim.driving import road


@pytest.mark.parametrize("road_class", ["A", "C", "E"])
def test_random_road_has_the_density_of_its_class(road_class):
    """Welch's estimate against ISO 8608: G(n) = G(n0) (n/n0)^-2 with n0 = 0.1 cycles/m."""
    for seed, profile in enumerate(
        road.random_tracks(road_class, length=4000.0, track=1.7, seed=1)
    ):
        frequency, density = signal.welch(profile, fs=1 / road.STEP, nperseg=8192)
        band = (frequency > 0.05) & (frequency < 2.0)
        expected = road.CLASSES[road_class] * (frequency[band] / 0.1) ** -2
        ratio = density[band] / expected
        assert np.exp(np.log(ratio).mean()) == pytest.approx(1.0, abs=0.2), seed


def test_tracks_agree_on_long_waves_only():
    left, right = road.random_tracks("C", length=8000.0, track=1.7, seed=5)
    frequency, coherence = signal.coherence(left, right, fs=1 / road.STEP, nperseg=4096)
    long_waves = coherence[(frequency > 0.02) & (frequency < 0.06)].mean()
    short_waves = coherence[(frequency > 1.5) & (frequency < 2.5)].mean()
    assert long_waves > 0.9 and short_waves < 0.2


def test_bumps_are_where_they_were_asked_for():
    profile = road.bumps(height=0.05, length=1.0, spacing=10.0, count=3, start=20.0)
    position = np.arange(profile.size) * road.STEP
    peaks, _ = signal.find_peaks(profile)
    assert position[peaks] == pytest.approx([20.5, 30.5, 40.5], abs=0.03)
    assert profile.max() == pytest.approx(0.05, rel=1e-3)
