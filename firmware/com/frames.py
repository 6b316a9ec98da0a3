"""Bytes of a mailbox each way; made by codegen.generated.frames, not to be edited."""

RX_BYTES = 8
TX_BYTES = 8
