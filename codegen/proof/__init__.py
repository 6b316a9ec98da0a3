"""Abstract interpretation on intervals: proof that no operation of the firmware overflows."""
