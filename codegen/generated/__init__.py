"""The sources that are generated for the firmware: its signals and its limits."""
