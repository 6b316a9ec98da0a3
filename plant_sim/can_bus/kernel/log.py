"""Record types of a bus network's arrays. Times in nanoseconds."""

from typing import Final

import numpy as np

SEGMENT: Final = np.dtype(
    [
        ("bitrate", "i8"),
        ("data_bitrate", "i8"),
        ("bit_ns", "i8"),
        ("propagation_ns", "i8"),
        ("bit_error_rate", "f8"),
        ("free_ns", "i8"),
        ("wake_ns", "i8"),
        ("pending", "i8"),
        ("in_flight", "i8"),
        ("twin", "i8"),
        ("start_ns", "i8"),
        ("done_ns", "i8"),
        ("end_ns", "i8"),
        ("disturbance", "i8"),
        ("busy_ns", "i8"),
        ("transmissions", "i8"),
        ("overloads", "i8"),
        ("disturbed", "i8"),
        ("bus_off", "i8"),
        ("idle_from_ns", "i8"),
        ("missed", "i8"),
    ]
)
_DRAWN: Final = [
    ("low_ns", "i8"),
    ("high_ns", "i8"),
    ("first_sample", "i8"),
    ("samples", "i8"),
    ("drawn", "i8"),
]
"""A time drawn for every frame, of so many samples if there are any, and the number of draws."""
NODE: Final = np.dtype(
    [
        *_DRAWN,
        ("segment", "i8"),
        ("policy", "i8"),
        ("capacity", "i8"),
        ("pending", "i8"),
        ("single_shot", "i8"),
        ("recovers", "i8"),
        ("drift", "f8"),
        ("transmit_errors", "i8"),
        ("receive_errors", "i8"),
        ("state", "i8"),
        ("suspended_ns", "i8"),
        ("recovery_left", "i8"),
        ("bus_offs", "i8"),
        ("off_ns", "i8"),
        ("on_ns", "i8"),
        ("delayed_ns", "i8"),
    ]
)
MESSAGE: Final = np.dtype(
    [
        ("key", "i8"),
        ("ident", "i8"),
        ("flags", "i8"),
        ("node", "i8"),
        ("gateways", "i8"),
        ("offered", "i8"),
        ("delivered", "i8"),
        ("superseded", "i8"),
        ("lost", "i8"),
        ("attempts", "i8"),
        ("response_sum", "i8"),
        ("response_min", "i8"),
        ("response_max", "i8"),
    ]
)
QUEUE: Final = np.dtype([("head", "i8"), ("tail", "i8"), ("waiting", "i8")])
FRAME: Final = np.dtype(
    [
        ("next", "i8"),
        ("message", "i8"),
        ("node", "i8"),
        ("ident", "i8"),
        ("flags", "i8"),
        ("length", "i8"),
        ("bits", "i8"),
        ("attempts", "i8"),
        ("held", "i8"),
        ("t_origin", "i8"),
        ("t_queued", "i8"),
    ]
)
SOURCE: Final = np.dtype(
    [
        ("node", "i8"),
        ("message", "i8"),
        ("ident", "i8"),
        ("flags", "i8"),
        ("length", "i8"),
        ("bits", "i8"),
        ("period_ns", "f8"),
        ("offset_ns", "i8"),
        ("jitter_ns", "i8"),
        ("until_ns", "i8"),
        ("random_payload", "i8"),
        ("sent", "i8"),
    ]
)
RELEASE: Final = np.dtype([("t_ns", "i8"), ("tie", "i8"), ("value", "i8"), ("next", "i8")])
GATEWAY: Final = np.dtype(
    [
        *_DRAWN,
        ("from_node", "i8"),
        ("to_node", "i8"),
        ("routes", "i8"),
        ("last_ns", "i8"),
    ]
)
FAULT: Final = np.dtype(
    [
        ("kind", "i8"),
        ("target", "i8"),
        ("from_ns", "i8"),
        ("until_ns", "i8"),
        ("ident", "i8"),
        ("value", "i8"),
        ("left", "i8"),
        ("rate", "f8"),
    ]
)


def log_dtype() -> np.dtype[np.void]:
    """Return the dtype of one log entry.

    Times are nanoseconds: ``t_origin`` when the first sender queued it (gateways keep it),
    ``t_queued``, ``t_start`` of the successful or last attempt (−1: never sent), ``t_received``
    (the instant of reception, or of the loss or error) and ``t_end`` of the interframe space.
    ``missed``: the one receiver that did not take a frame the others took, or −1.
    """
    return np.dtype(
        [
            ("t_origin", "i8"),
            ("t_queued", "i8"),
            ("t_start", "i8"),
            ("t_received", "i8"),
            ("t_end", "i8"),
            ("ident", "u4"),
            ("sender", "i2"),
            ("segment", "u1"),
            ("flags", "u1"),
            ("length", "u1"),
            ("outcome", "u1"),
            ("attempts", "u2"),
            ("missed", "i2"),
            ("payload", "u1", (64,)),
        ]
    )
