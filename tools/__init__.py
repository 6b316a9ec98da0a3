"""Tools for developers of canroll; not part of the installed package."""
