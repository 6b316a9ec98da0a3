"""Monte Carlo campaigns: draws of many worlds, on one machine or on many, and what follows."""
