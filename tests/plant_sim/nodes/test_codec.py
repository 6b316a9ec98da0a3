"""The plant's array codec against cantools, frame by frame."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from canroll import dbc
from canroll.errors import UnknownNameError
from canroll.plant_sim.nodes import codec, codec_tables

TABLES = codec_tables.load()
MESSAGES = dbc.load().messages


def empty() -> np.ndarray:
    return np.zeros(codec.MAX_PAYLOAD, np.uint8)


def array_of(data: bytes) -> np.ndarray:
    return np.frombuffer(data.ljust(codec.MAX_PAYLOAD, b"\0"), np.uint8).copy()


@st.composite
def raw_messages(draw):
    message = draw(st.sampled_from(MESSAGES))
    switch = next((s for s in message.signals if s.is_multiplexer), None)
    pages = sorted({p for s in message.signals for p in s.multiplexer_ids or ()})
    page = draw(st.sampled_from(pages)) if switch else None
    raw = {}
    for signal in message.signals:
        if signal.is_multiplexer:
            raw[signal.name] = page
        elif not signal.multiplexer_ids or page in signal.multiplexer_ids:
            row = TABLES.field[codec_tables.signal_index(message.name, signal.name)]
            raw[signal.name] = draw(
                st.integers(int(row["raw_min"]), int(row["raw_max"]))
                | st.sampled_from([int(row["raw_min"]), int(row["raw_max"])])
            )
    return message, raw


@given(raw_messages())
def test_encode_and_decode_agree_with_cantools(case):
    message, raw = case
    expected = message.encode(raw, scaling=False)
    index = codec_tables.message_index(message.name)
    physical = message.decode(expected, decode_choices=False)
    names = codec_tables.signal_names(message.name)
    values = np.array([float(physical.get(name, math.nan)) for name in names])
    payload = empty()
    codec.encode(TABLES, index, values, payload)
    assert payload[: message.length].tobytes() == expected

    decoded = np.empty(len(names))
    codec.decode(TABLES, index, array_of(expected), decoded)
    for name, value in zip(names, decoded, strict=True):
        if name in physical:
            assert value == pytest.approx(float(physical[name]), rel=1e-15, abs=1e-15)
        else:
            assert math.isnan(value)


@settings(deadline=None)
@example(163.828, "RollRate")
@example(-163.828, "RollRate")
@given(st.floats(-1e4, 1e4), st.sampled_from(["RollRate", "LateralAcceleration", "YawRate"]))
def test_rounds_to_nearest_and_clips_to_the_range_of_the_dbc(value, name):
    signal = dbc.load().get_message_by_name("Imu").get_signal_by_name(name)
    row = codec_tables.signal_index("Imu", name)
    raw = codec.raw_value(TABLES, row, value)
    kept = min(max(value, signal.minimum), signal.maximum)
    assert abs(raw * signal.scale - kept) <= signal.scale / 2 * (1 + 1e-9)
    assert codec.valid(TABLES, row, raw)


def test_not_a_number_is_sent_as_the_error_code():
    row = codec_tables.signal_index("Imu", "RollRate")
    raw = codec.raw_value(TABLES, row, math.nan)
    signal = dbc.load().get_message_by_name("Imu").get_signal_by_name("RollRate")
    assert str(signal.choices[raw]) == "Error"
    assert not codec.valid(TABLES, row, raw)


def test_insert_leaves_every_other_bit_alone():
    row = codec_tables.signal_index("SuspensionForceCommand", "ForceFrontRight")
    payload = np.full(codec.MAX_PAYLOAD, 255, np.uint8)
    codec.insert(TABLES, row, payload, 5)
    assert codec.extract(TABLES, row, payload) == 5
    codec.insert(TABLES, row, payload, -1)
    assert np.all(payload == 255)


def test_tables_hold_every_message_of_the_dbc():
    rows = TABLES.message[: len(MESSAGES)]
    assert [int(m["ident"]) for m in rows] == [m.frame_id for m in MESSAGES]
    assert not TABLES.message[len(MESSAGES) :]["length"].any()
    placed = np.count_nonzero(TABLES.field[:]["pieces"])
    assert placed == sum(len(m.signals) for m in MESSAGES)


def test_unknown_names_suggest_the_nearest():
    with pytest.raises(UnknownNameError, match="did you mean 'Imu'"):
        codec_tables.message_index("Imus")
    with pytest.raises(UnknownNameError, match="RollRate"):
        codec_tables.signal_index("Imu", "RollRat")
