"""Hostile input: fuzzing of the firmware and of every reader, kills, long runs."""
