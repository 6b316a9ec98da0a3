"""Bit rates of logs that say little: assumed where nothing contradicts, else asked for by name."""

import can
import pytest

from canroll.errors import CanrollError
from plant_sim.can_bus.traffic.inference import infer_bus, infer_buses

STEP = 0.01


def message(time, *, ident=0x100, channel=0, fd=False):
    return can.Message(
        timestamp=1000.0 + time,
        arbitration_id=ident,
        is_extended_id=False,
        is_fd=fd,
        bitrate_switch=fd,
        data=bytes(range(24 if fd else 8)),
        channel=channel,
    )


def written(path, messages):
    with can.Logger(str(path)) as logger:
        for one in sorted(messages, key=lambda m: m.timestamp):
            logger(one)
    return path


def pairs(gap, count=50, **options):
    """Two frames every 10 ms, ``gap`` apart and not quite regular, as stamped by a good logger."""
    for k in range(count):
        start = STEP * k + 1e-6 * (k * k % 7)
        yield message(start, **options)
        yield message(start + gap, ident=0x200, **options)


def burst(count=100, **options):
    """Frames 20 µs apart: a driver has read them all at once."""
    return [message(STEP * k + 2e-5 * n, **options) for k in range(count) for n in range(4)]


@pytest.mark.parametrize(
    ("gap", "nominal", "other"),
    [
        (5e-3, 500_000, {125_000, 250_000, 1_000_000}),
        (600e-6, 500_000, {250_000, 1_000_000}),
        (300e-6, 500_000, {1_000_000}),
        (150e-6, 1_000_000, set()),
    ],
)
def test_a_usual_rate_is_assumed_that_the_spacing_does_not_contradict(
    tmp_path, gap, nominal, other
):
    bus = infer_bus(written(tmp_path / "light.log", pairs(gap)))
    assert bus.rate.nominal == nominal
    assert set(bus.rate.other) == other
    assert bus.rate.assumed == ("bitrate",)
    assert bus.rate.pairs == 0
    (warning,) = bus.warnings
    assert warning.startswith(f"channel can0: {nominal // 1000} kbit/s assumed, too few frames")
    assert f"as @{nominal}" in warning


def test_a_single_frame_says_as_much(tmp_path):
    assert infer_bus(written(tmp_path / "one.log", [message(0.0)])).rate.nominal == 500_000


def test_the_data_rate_alone_is_assumed_if_the_other_is_given(tmp_path):
    path = written(tmp_path / "fd.asc", pairs(5e-3, fd=True))
    rate = infer_bus(path, bitrate=250_000).rate
    assert (rate.nominal, rate.data, rate.assumed) == (250_000, 2_000_000, ("data_bitrate",))
    rate = infer_bus(path).rate
    assert (rate.nominal, rate.data) == (500_000, 2_000_000)
    assert rate.assumed == ("bitrate", "data_bitrate")
    given = infer_bus(path, bitrate=500_000, data_bitrate=5_000_000)
    assert (given.rate.data, given.warnings) == (5_000_000, ())


def test_a_short_frame_of_fast_data_contradicts_slow_data(tmp_path):
    path = written(tmp_path / "fd.asc", pairs(120e-6, fd=True))
    assert infer_bus(path, bitrate=500_000).rate.data == 5_000_000


def test_coarse_stamps_are_no_evidence_and_contradict_nothing_within_their_step(tmp_path):
    frames = [message(round(STEP * k + 1e-4 * (3 * k % 2), 4)) for k in range(200)]
    frames += [message(m.timestamp - 1000.0 + 2e-4, ident=0x200) for m in frames]
    rate = infer_bus(written(tmp_path / "coarse.log", frames)).rate
    assert (rate.nominal, rate.pairs, rate.assumed) == (500_000, 0, ("bitrate",))


def test_what_is_missing_is_said_for_every_channel_with_its_option(tmp_path):
    frames = [*burst(), *pairs(5e-3, channel=1), *burst(channel=2, fd=True)]
    path = written(tmp_path / "three.asc", frames)
    with pytest.raises(CanrollError) as refusal:
        infer_buses(path)
    one, two = str(refusal.value).split("; ")
    assert "channel 0: the bit rate cannot be inferred" in one
    assert "add --bitrate 500000 to 'canroll bus', or @500000 to the file's name" in one
    assert "channel 2: the bit rate and the data bit rate cannot be inferred" in two
    assert "--bitrate 500000 --data-bitrate 2000000" in two
    with pytest.raises(CanrollError, match="channel 2: the data bit rate cannot be inferred") as fd:
        infer_buses(path, bitrate=250_000)
    assert "add --data-bitrate 2000000 to 'canroll bus', or @250000/2000000" in str(fd.value)
    assert "channel 0" not in str(fd.value)
    assert len(infer_buses(path, bitrate=250_000, data_bitrate=2_000_000)) == 3
