"""The 14-DOF car as a MuJoCo tree of rigid bodies, from a vehicle's data and nothing else.

World axes are those of the heading frame R at the evaluated instant: x along the heading in the
road plane, y left in the plane, z the road's normal, with the road plane at z = 0. The sprung body
is free: three slides move P, its point on the roll axis, then it turns about the vertical (with
R), pitches and rolls. R needs no body of its own: its rotation only enters where accelerations
along fixed axes become rates of components along R's axes.
"""

from dataclasses import dataclass, field
from functools import partial
from math import sqrt

import mujoco
import numpy as np

from canroll.plant_sim.bodies import ports
from canroll.typing import Vector
from canroll.vehicles import GRAVITY, Vehicle
from support.corner_forces import Suspension, Tyre

AXLES = ("front", "rear")
SIDES = ("left", "right")
NORMAL = np.array([0.0, 0.0, 1.0])


_pair, _triple, _four = (partial(np.zeros, count) for count in (2, 3, 4))


@dataclass
class State:
    """Positions and velocities of the car; wheels in the order of the ports.

    ``velocity`` is that of P along the road plane; ``yaw_rate`` the part along the normal of R's
    rotation about the vertical; ``heave`` the height of P over the static one; ``travel`` of the
    suspension > 0 in extension; ``spin`` absolute; ``slip`` the tyres' lateral slip.
    """

    velocity: Vector = field(default_factory=_pair)
    yaw_rate: float = 0.0
    heave: float = 0.0
    roll: float = 0.0
    pitch: float = 0.0
    heave_rate: float = 0.0
    roll_rate: float = 0.0
    pitch_rate: float = 0.0
    travel: Vector = field(default_factory=_four)
    travel_rate: Vector = field(default_factory=_four)
    spin: Vector = field(default_factory=_four)
    slip: Vector = field(default_factory=_four)


@dataclass
class Motion:
    """What follows from a state: rates of its velocities, forces, and what sensors would see."""

    foot: Vector = field(default_factory=_pair)
    """Velocity of P's foot on the road along R's axes (m/s)."""
    velocity: Vector = field(default_factory=_pair)
    yaw_rate: float = 0.0
    heave_rate: float = 0.0
    roll_rate: float = 0.0
    pitch_rate: float = 0.0
    travel_rate: Vector = field(default_factory=_four)
    spin: Vector = field(default_factory=_four)
    slip: Vector = field(default_factory=_four)
    load: Vector = field(default_factory=_four)
    lateral: Vector = field(default_factory=_four)
    """Tyre forces along R's left (N)."""
    cg: Vector = field(default_factory=_triple)
    """Inertial acceleration of the whole car's CG along R's axes (m/s²)."""
    sprung_cg: Vector = field(default_factory=_triple)
    gyro: Vector = field(default_factory=_triple)
    """Angular rate along the body's axes (rad/s), of MuJoCo's sensor."""
    accelerometer: Vector = field(default_factory=_triple)
    """Specific force at the IMU along the body's axes (m/s²), of MuJoCo's sensor."""


def vertical(inputs: Vector) -> Vector:
    """Unit vector upwards along R's axes."""
    bank, grade = inputs[ports.BANK], inputs[ports.GRADE]
    level = np.cos(grade)
    return np.array([np.sin(grade), np.sin(bank) * level, np.cos(bank) * level])


def mjcf(vehicle: Vehicle) -> str:
    """Model of the car in MuJoCo's XML, standing still on a flat road."""
    geometry, plant, mass, tyre = vehicle.geometry, vehicle.plant, vehicle.mass, vehicle.tyre
    axis, offset = vehicle.roll_axis_height, vehicle.sprung_cg_offset
    axles, yaw_inertia = "", mass.yaw_inertia - plant.sprung_mass * offset**2
    for name, unsprung, distance, half_track, centre in (
        (
            "front",
            mass.unsprung_front,
            geometry.cg_to_front_axle,
            geometry.half_track_front,
            geometry.roll_centre_height_front,
        ),
        (
            "rear",
            mass.unsprung_rear,
            -geometry.cg_to_rear_axle,
            geometry.half_track_rear,
            geometry.roll_centre_height_rear,
        ),
    ):
        yaw_inertia -= unsprung * (distance**2 + half_track**2)
        hub, across = tyre.radius - centre, unsprung * half_track**2
        wheels = "".join(
            f"""
      <body name="{name}_{side}" pos="0 {y!r} {hub!r}">
        <joint name="spin_{name}_{side}" type="hinge" axis="0 1 0"/>
        <inertial pos="0 0 0" mass="1e-9"
          diaginertia="{tyre.wheel_inertia!r} {tyre.wheel_inertia!r} {tyre.wheel_inertia!r}"/>
      </body>"""
            for side, y in zip(SIDES, (half_track, -half_track), strict=True)
        )
        axles += f"""
    <body name="{name}" pos="{distance - offset!r} 0 {centre - axis!r}">
      <joint name="slide_{name}" type="slide" axis="0 0 1"/>
      <joint name="hinge_{name}" type="hinge" axis="1 0 0"/>
      <inertial pos="0 0 {hub!r}" mass="{unsprung!r}" diaginertia="{across!r} 1e-9 {across!r}"/>
      {wheels}
    </body>"""
    arm = plant.cg_height_above_roll_axis
    imu_x, imu_y, imu_z = vehicle.sensors.imu_position
    return f"""<mujoco>
<worldbody>
  <body name="sprung" pos="0 0 {axis!r}">
    <joint name="x" type="slide" axis="1 0 0"/>
    <joint name="y" type="slide" axis="0 1 0"/>
    <joint name="z" type="slide" axis="0 0 1"/>
    <joint name="yaw" type="hinge" axis="0 0 1"/>
    <joint name="pitch" type="hinge" axis="0 1 0"/>
    <joint name="roll" type="hinge" axis="1 0 0"/>
    <inertial pos="0 0 {arm!r}" mass="{plant.sprung_mass!r}"
      diaginertia="{plant.inertia_about_cg!r} {mass.pitch_inertia!r} {yaw_inertia!r}"/>
    <site name="imu" pos="{imu_x!r} {imu_y!r} {arm + imu_z!r}"/>
    {axles}
  </body>
</worldbody>
<sensor><gyro site="imu"/><accelerometer site="imu"/></sensor>
</mujoco>"""


class Car:
    """A vehicle's MuJoCo model with the forces at its corners."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle = vehicle
        self.model = mujoco.MjModel.from_xml_string(mjcf(vehicle))
        self.data = mujoco.MjData(self.model)
        self.suspensions = [Suspension(vehicle, axle) for axle in range(2)]
        self.tyres = [Tyre(vehicle, axle) for axle in range(2)]
        self.sprung = self.model.body("sprung").id
        self.axles = [self.model.body(name).id for name in AXLES]
        wheels = [f"{axle}_{side}" for axle in AXLES for side in SIDES]
        self.wheels = [self.model.body(name).id for name in wheels]
        self.spins = np.array([self._dof(f"spin_{name}") for name in wheels])
        self.slides = np.array([self._dof(f"slide_{name}") for name in AXLES])
        self.hinges = np.array([self._dof(f"hinge_{name}") for name in AXLES])
        self.half_tracks = np.array([s.half_track for s in self.suspensions])
        # the axle has the wheels' masses and diametral inertia; the compiler insists on both
        self.model.body_mass[self.wheels] = 0.0
        self.model.body_inertia[self.wheels, 0] = 0.0
        self.model.body_inertia[self.wheels, 2] = 0.0
        mujoco.mj_setConst(self.model, self.data)

    def _dof(self, joint: str) -> int:
        # every joint has one degree of freedom, so that one index does for qpos and qvel
        return int(self.model.joint(joint).dofadr[0])

    def _spread(self, wheels: Vector) -> tuple[Vector, Vector]:
        """Slides and hinges of the axles with these suspension travels, or rates."""
        left, right = wheels[0::2], wheels[1::2]
        return -(left + right) / 2, -(left - right) / (2 * self.half_tracks)

    def place(self, state: State, inputs: Vector) -> None:
        """Put the model into a state, on the road and with the steering angle of ``inputs``."""
        model, data, up = self.model, self.data, vertical(inputs)
        mujoco.mj_resetData(model, data)
        model.opt.gravity[:] = -GRAVITY * up
        model.jnt_axis[model.joint("yaw").id] = up
        half = inputs[ports.STEER] / 2
        model.body_quat[self.wheels[:2]] = np.cos(half), 0.0, 0.0, np.sin(half)
        data.qpos[:6] = 0.0, 0.0, state.heave, 0.0, state.pitch, state.roll
        data.qpos[self.slides], data.qpos[self.hinges] = self._spread(state.travel)
        turn = state.yaw_rate / up[2]
        data.qvel[:3] = *state.velocity, state.heave_rate
        data.qvel[3:6] = turn, state.pitch_rate, state.roll_rate
        data.qvel[self.slides], data.qvel[self.hinges] = self._spread(state.travel_rate)
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        for wheel, (body, dof) in enumerate(zip(self.wheels, self.spins, strict=True)):
            carried = self._velocity(self.axles[wheel // 2])[0] @ self._spin_axis(body)
            data.qvel[dof] = state.spin[wheel] - carried
        mujoco.mj_fwdVelocity(model, data)

    def _velocity(self, body: int) -> tuple[Vector, Vector]:
        """Angular velocity, and velocity of the body's origin."""
        spatial = np.zeros(6)
        mujoco.mj_objectVelocity(self.model, self.data, mujoco.mjtObj.mjOBJ_XBODY, body, spatial, 0)
        return spatial[:3], spatial[3:]

    def _acceleration(self, body: int) -> tuple[Vector, Vector]:
        """Angular acceleration, and inertial acceleration of the body's CG."""
        spatial = np.zeros(6)
        mujoco.mj_objectAcceleration(
            self.model, self.data, mujoco.mjtObj.mjOBJ_BODY, body, spatial, 0
        )
        # MuJoCo lets the world accelerate upwards instead of gravity
        return spatial[:3], spatial[3:] + self.model.opt.gravity

    def _spin_axis(self, wheel: int) -> Vector:
        axis: Vector = self.data.xmat[wheel].reshape(3, 3)[:, 1].copy()
        return axis

    def _suspend(self, state: State, inputs: Vector, applied: Vector) -> None:
        for axle, suspension in enumerate(self.suspensions):
            corners = slice(2 * axle, 2 * axle + 2)
            actuators = inputs[ports.CORNER_FORCE : ports.CORNER_FORCE + 4][corners]
            left, right = suspension.forces(
                state.travel[corners],
                state.travel_rate[corners],
                actuators,
                inputs[ports.BAR_MOMENT_FRONT + axle],
            )
            # work of the forces on travels −(s + t ρ) and −(s − t ρ)
            applied[self.slides[axle]] -= left + right
            applied[self.hinges[axle]] -= suspension.half_track * (left - right)

    def _roll(
        self, wheel: int, state: State, inputs: Vector, applied: Vector, motion: Motion
    ) -> None:
        """Add the forces of a tyre and of its shaft."""
        tyre, body, radius = self.tyres[wheel // 2], self.wheels[wheel], self.vehicle.tyre.radius
        axis, hub = self._spin_axis(body), self.data.xpos[body].copy()
        tilt = float(NORMAL @ axis)
        upright = sqrt(1 - tilt**2)
        loaded = float(hub[2] - inputs[ports.ROAD_HEIGHT + wheel]) / upright
        lever = -loaded * (NORMAL - tilt * axis) / upright
        turning, _ = self._velocity(self.axles[wheel // 2])
        _, hub_velocity = self._velocity(body)
        contact = hub_velocity + np.cross(turning - (turning @ axis) * axis, lever)
        ahead = np.cross(axis, NORMAL) / upright
        aside = np.cross(NORMAL, ahead)
        along, across = float(contact @ ahead), float(contact @ aside)

        spin, side_slip = state.spin[wheel], state.slip[wheel]
        load = tyre.normal(loaded, contact[2] / upright, upright)
        friction = inputs[ports.FRICTION] + inputs[ports.WHEEL_FRICTION + wheel]
        long, lateral = tyre.horizontal(load, friction, along, spin, side_slip)
        force = long * ahead + lateral * aside + load * NORMAL
        sense = spin / max(abs(spin), 1.0)
        resistance = self.vehicle.tyre.rolling_resistance * load * sense
        couple = -(long + resistance) * radius - axis @ np.cross(lever, force)
        mujoco.mj_applyFT(self.model, self.data, force, couple * axis, hub + lever, body, applied)
        share = tyre.static / (self.vehicle.total_mass * GRAVITY)
        shaft = inputs[ports.DRIVE_FORCE] * share - inputs[ports.BRAKE_FORCE + wheel] * sense
        applied[self.spins[wheel]] += shaft * radius

        motion.load[wheel] = load
        motion.lateral[wheel] = force[1]
        motion.slip[wheel] = tyre.relaxation(along, across, side_slip)

    def motion(self, state: State, inputs: Vector) -> Motion:
        """Accelerations of the car in a state under the ``inputs`` of the ports."""
        self.place(state, inputs)
        model, data, motion = self.model, self.data, Motion()
        applied = data.qfrc_applied
        self._suspend(state, inputs, applied)
        for wheel in range(4):
            self._roll(wheel, state, inputs, applied, motion)
        # the wind, from the road under the whole car's CG
        wind = np.array([0.0, inputs[ports.WIND_FORCE], 0.0])
        turned = np.array([inputs[ports.WIND_ROLL], 0.0, inputs[ports.WIND_YAW]])
        under = np.array([-self.vehicle.sprung_cg_offset, 0.0, 0.0])
        mujoco.mj_applyFT(model, data, wind, turned, under, self.sprung, applied)
        mujoco.mj_forward(model, data)
        mujoco.mj_rnePostConstraint(model, data)

        up = vertical(inputs)
        turning = state.yaw_rate * up / up[2]
        height = self.vehicle.roll_axis_height + state.heave
        motion.foot = state.velocity - np.cross(turning, height * NORMAL)[:2]
        seen = data.qacc[:3] - np.cross(turning, data.qvel[:3])
        motion.velocity, motion.heave_rate = seen[:2], float(seen[2])
        motion.yaw_rate = float(data.qacc[3] * up[2])
        motion.pitch_rate, motion.roll_rate = map(float, data.qacc[4:6])
        slides, tilts = data.qacc[self.slides], data.qacc[self.hinges] * self.half_tracks
        motion.travel_rate[0::2], motion.travel_rate[1::2] = -(slides + tilts), -(slides - tilts)
        for wheel, body in enumerate(self.wheels):
            # the axis turns with the carrier, which does not change the spin's rate along it
            motion.spin[wheel] = self._acceleration(body)[0] @ self._spin_axis(body)
        massive = [self.sprung, *self.axles]
        accelerations = np.array([self._acceleration(body)[1] for body in massive])
        motion.sprung_cg = accelerations[0]
        motion.cg = np.average(accelerations, axis=0, weights=model.body_mass[massive])
        motion.gyro, motion.accelerometer = data.sensordata[:3].copy(), data.sensordata[3:].copy()
        return motion
