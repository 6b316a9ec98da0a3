"""The record of SecOC: expanded key, subkeys of the CMAC, freshness values.

It is apart from the ECU's records: no calibration, measurement or log contains a key.
"""

from typing import Annotated

from canroll.firmware.com.frames import N_FRAMES
from canroll.firmware.state import N_TX
from canroll.firmware.subset import I32_MAX, I32_MIN, F, i32, record, u8

# a secured frame: the frame, its freshness value, and the first six bytes of the CMAC
PAYLOAD = 8
FRESHNESS_AT = 8
MAC_AT = 14
SECURED = 20
# what is authenticated: data id, payload, freshness value; longest message of the CMAC
AUTHENTICATED = 16
MESSAGE_MAX = 64
COUNTER_MAX = (1 << 24) - 1
RESET_MAX = (1 << 24) - 1
LISTENING_MAX = 1000
NONE = -1


@record
class Secoc:
    """State of the authentication of one ECU's frames; the caller owns it, ``start`` fills it."""

    round_key: Annotated[list[i32], 44, F(I32_MIN, I32_MAX, 0, "", "expanded key")]
    subkey: Annotated[list[list[i32]], 2, 4, F(I32_MIN, I32_MAX, 0, "", "K1, K2 of the CMAC")]
    block: Annotated[list[i32], 4, F(I32_MIN, I32_MAX, 0, "", "of AES, big endian")]
    tx_reset: Annotated[i32, F(0, RESET_MAX, 0, "", "starts of this ECU so far")]
    tx_freshness: Annotated[list[i32], N_TX, F(0, COUNTER_MAX, 0, "", "frames sent since")]
    rx_reset: Annotated[list[i32], N_FRAMES, F(0, RESET_MAX, 0, "", "starts of the sender so far")]
    rx_freshness: Annotated[
        list[i32], N_FRAMES, F(NONE, COUNTER_MAX, 0, "", "of the last authentic frame, -1: none")
    ]
    listening: Annotated[i32, F(0, LISTENING_MAX, 0, "ticks", "until the first frame is taken")]
    refused: Annotated[i32, F(0, I32_MAX, 0, "", "frames refused, saturates")]
    message: Annotated[list[u8], MESSAGE_MAX, F(0, 255, 0, "", "what the CMAC is of")]
