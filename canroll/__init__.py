"""From a roll-stability control law to code on an ECU that talks CAN, proved on the way."""
