"""Certificates: stability and bounds of the loop of the integers, in exact and ball arithmetic."""
