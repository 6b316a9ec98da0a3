"""Authentication of frames, after AUTOSAR SecOC: beside the loop, which knows nothing of it."""
