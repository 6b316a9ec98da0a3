"""Abstract interpretation on intervals: that no operation of the firmware overflows."""
