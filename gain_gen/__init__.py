"""Vehicle design models to verified, quantised gains."""

if __name__ == "gain_gen":  # not as a second copy, where the checkout is on the path
    raise ImportError("the package is canroll.gain_gen")
