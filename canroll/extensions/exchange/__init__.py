"""Runs and their parts for other tools: FMUs and MCAP; and models of theirs."""
