"""What every kernel builds on: compilation, records as arrays, random numbers."""
