"""A run in real time or lock step: ECU and plant as two programs."""

if __name__ == "hil":  # not as a second copy, where the checkout is on the path
    raise ImportError("the package is canroll.hil")
