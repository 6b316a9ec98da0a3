"""Validation of the 14-DOF plant by an independent multi-body car: the CommonRoad package."""
