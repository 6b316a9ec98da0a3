"""Frames of the bus contract, packed by cantools."""

import dbc


def frame(name: str, **signals: float | str) -> tuple[int, bytes]:
    """Return identifier and payload of a message; signals that are not named are 0."""
    message = dbc.load().get_message_by_name(name)
    plain = (s for s in message.signals if not s.is_multiplexer and not s.multiplexer_ids)
    values: dict[str, float | str] = {signal.name: 0 for signal in plain}
    return message.frame_id, message.encode(values | signals, strict=True)
