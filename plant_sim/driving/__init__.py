"""Road, path, driver, manoeuvres and their names, and the standards' criteria."""

from typing import TYPE_CHECKING

from canroll.registry import Registry

if TYPE_CHECKING:
    from plant_sim.driving.drive import ManeuverKind

MANEUVERS: "Registry[ManeuverKind]" = Registry(
    "scenario",
    "canroll.scenarios",
    {
        "double_lane_change": "plant_sim.driving.path_maneuvers:DOUBLE_LANE_CHANGE",
        "moose": "plant_sim.driving.path_maneuvers:MOOSE",
        "slalom": "plant_sim.driving.path_maneuvers:SLALOM",
        "roundabout": "plant_sim.driving.path_maneuvers:ROUNDABOUT",
        "constant_radius": "plant_sim.driving.path_maneuvers:CONSTANT_RADIUS",
        "banked_curve": "plant_sim.driving.path_maneuvers:BANKED_CURVE",
        "bumps": "plant_sim.driving.path_maneuvers:BUMPS",
        "random_road": "plant_sim.driving.path_maneuvers:RANDOM_ROAD",
        "crosswind": "plant_sim.driving.path_maneuvers:CROSSWIND",
        "split_friction": "plant_sim.driving.path_maneuvers:SPLIT_FRICTION",
        "friction_jump": "plant_sim.driving.path_maneuvers:FRICTION_JUMP",
        "step_steer": "plant_sim.driving.steer_maneuvers:STEP_STEER",
        "sine_sweep": "plant_sim.driving.steer_maneuvers:SINE_SWEEP",
        "braking_in_curve": "plant_sim.driving.steer_maneuvers:BRAKING_IN_CURVE",
        "power_off_in_curve": "plant_sim.driving.steer_maneuvers:POWER_OFF_IN_CURVE",
        "fishhook": "plant_sim.driving.steer_maneuvers:NHTSA_FISHHOOK",
        "j_turn": "plant_sim.driving.steer_maneuvers:J_TURN",
        "sine_with_dwell": "plant_sim.driving.steer_maneuvers:SINE_WITH_DWELL",
        "from_file": "plant_sim.driving.file_maneuver:FROM_FILE",
    },
    accept="plant_sim.driving.offered:accept",
)
