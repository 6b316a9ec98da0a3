"""Everything outside the ECU: vehicle, actuators, sensors, driver, road and the CAN bus."""
