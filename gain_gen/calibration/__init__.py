"""A design as integers: quantised, its rounding error analysed, in a file."""
