"""Axles by tables: springs, dampers, stops, kinematics and compliance as measured on a rig."""
