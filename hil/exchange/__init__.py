"""Parts of a run for other tools, and their models as parts of a run."""
