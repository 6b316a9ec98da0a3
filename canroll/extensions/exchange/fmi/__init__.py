"""FMUs of other tools as the plant: Co-Simulation of FMI 2.0 and 3.0, by a map of variables."""
