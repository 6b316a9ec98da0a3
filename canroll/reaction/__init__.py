"""What the ECU noticed of the faults in a run, and the harm they did."""
