"""Services beside the loop, each optional: measurement and calibration, diagnostics."""
