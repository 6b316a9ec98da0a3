"""What the ECU did with frames, what it noticed of the faults in a run, and the harm they did."""
