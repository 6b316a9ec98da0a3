"""Commands that drive many runs."""
