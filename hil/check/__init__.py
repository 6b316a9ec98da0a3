"""The shortest tick this machine can sustain, measured before hardware is connected."""
