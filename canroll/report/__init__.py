"""The report: one self-contained page with interactive plots, and a picture."""
