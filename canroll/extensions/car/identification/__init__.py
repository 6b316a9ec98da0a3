"""A vehicle's numbers from a measured drive: logs, output error, and what a log cannot tell."""
