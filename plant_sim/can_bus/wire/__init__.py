"""A frame as bits: layout, stuffing, CRC, durations."""
