"""What tick this machine can hold, measured before hardware is connected."""
