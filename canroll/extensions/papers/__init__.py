"""The tables of the four papers recomputed: printed value, ours, difference, verdict, reason."""
