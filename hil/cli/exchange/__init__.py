"""Commands that write or read what other tools exchange."""
