"""Response times of the messages on a network, and the delay over it."""

SENSOR = "Imu"
"""Message with the samples whose delay is shown, if the network has it."""
COMMANDS = ("AntiRollBarCommand", "SuspensionForceCommand", "DamperCommand", "ValveCommand")
"""Commands to which the delay is shown: the first that is present, with that of the default
actuators before the others."""
