"""Formats of bus logs: each reader gives numbered messages and says what it left out."""
