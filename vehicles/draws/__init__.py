"""Cars that a fitted vehicle may be: draws from the spread of its numbers."""
