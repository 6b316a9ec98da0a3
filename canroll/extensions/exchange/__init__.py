"""Runs and their parts for other tools: FMUs, signal files, data sets; and models of theirs."""
