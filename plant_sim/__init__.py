"""Everything outside the ECU: vehicle, actuators, sensors, driver, road and the CAN bus."""

if __name__ == "plant_sim":  # not as a second copy, where the checkout is on the path
    raise ImportError("the package is canroll.plant_sim")
