"""Road, path, driver, manoeuvres and their names, and the standards' criteria."""

from typing import TYPE_CHECKING

from canroll.registry import Registry

if TYPE_CHECKING:
    from canroll.plant_sim.driving.drive import ManeuverKind

MANEUVERS: "Registry[ManeuverKind]" = Registry(
    "scenario",
    "canroll.scenarios",
    {
        "double_lane_change": "canroll.plant_sim.driving.path_maneuvers:DOUBLE_LANE_CHANGE",
        "moose": "canroll.plant_sim.driving.path_maneuvers:MOOSE",
        "slalom": "canroll.plant_sim.driving.path_maneuvers:SLALOM",
        "roundabout": "canroll.plant_sim.driving.path_maneuvers:ROUNDABOUT",
        "constant_radius": "canroll.plant_sim.driving.path_maneuvers:CONSTANT_RADIUS",
        "banked_curve": "canroll.plant_sim.driving.path_maneuvers:BANKED_CURVE",
        "bumps": "canroll.plant_sim.driving.path_maneuvers:BUMPS",
        "random_road": "canroll.plant_sim.driving.path_maneuvers:RANDOM_ROAD",
        "crosswind": "canroll.plant_sim.driving.path_maneuvers:CROSSWIND",
        "split_friction": "canroll.plant_sim.driving.path_maneuvers:SPLIT_FRICTION",
        "friction_jump": "canroll.plant_sim.driving.path_maneuvers:FRICTION_JUMP",
        "step_steer": "canroll.plant_sim.driving.steer_maneuvers:STEP_STEER",
        "sine_sweep": "canroll.plant_sim.driving.steer_maneuvers:SINE_SWEEP",
        "braking_in_curve": "canroll.plant_sim.driving.steer_maneuvers:BRAKING_IN_CURVE",
        "power_off_in_curve": "canroll.plant_sim.driving.steer_maneuvers:POWER_OFF_IN_CURVE",
        "fishhook": "canroll.plant_sim.driving.steer_maneuvers:NHTSA_FISHHOOK",
        "j_turn": "canroll.plant_sim.driving.steer_maneuvers:J_TURN",
        "sine_with_dwell": "canroll.plant_sim.driving.steer_maneuvers:SINE_WITH_DWELL",
        "from_file": "canroll.plant_sim.driving.file_maneuver:FROM_FILE",
    },
    accept="canroll.plant_sim.driving.offered:accept",
)
