"""Tools for whoever changes canroll; no part of the installed package."""
