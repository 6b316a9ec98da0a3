"""One frame: places and units of its signals, checksum and counter."""
