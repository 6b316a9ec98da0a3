"""Emission of the subset as C99."""


def record_name(name: str) -> str:
    """The C type of a record class."""
    return f"canroll_{name.lower()}"
