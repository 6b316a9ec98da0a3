"""A vehicle validated by measured drives: replayed, rated, and judged as its manoeuvre is."""
