"""What programs of others read and ask: an ECU for their tools, the data of a run in their formats."""
