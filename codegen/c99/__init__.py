"""The subset as C99."""
