"""The control laws, one family a module."""
