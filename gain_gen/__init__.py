"""Vehicle design models to verified, quantised gains."""
