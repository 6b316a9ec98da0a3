"""What programs of others read and ask: an ECU for their tools, runs in their formats."""
