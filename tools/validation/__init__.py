"""Our 14-DOF plant beside an independent multi-body car: the CommonRoad package."""
