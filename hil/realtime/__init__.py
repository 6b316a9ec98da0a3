"""Real time: ECU and plant as two programs on any python-can bus, each at absolute deadlines."""
