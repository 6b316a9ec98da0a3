"""Sound upper bounds of time and stack, from the linked machine code of a Cortex-M."""
