"""The operations of the integer subset, one row each: value, interval, obligations, C."""
