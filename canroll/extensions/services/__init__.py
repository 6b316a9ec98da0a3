"""XCP, UDS and non-volatile memory beside the firmware's loop."""
