"""The specific motion at a mounting point against numerical differentiation of its path."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from canroll.plant_sim.bodies import ports
from canroll.plant_sim.nodes.imu_motion import FORCE, GRAVITY, N_MOTION, RATE, specific_motion

angle = st.floats(-0.6, 0.6)
rate = st.floats(-1.5, 1.5)
acceleration = st.floats(-8, 8)
triple = st.tuples(rate, rate, rate)


def motion_of(inputs, outputs, arm):
    motion = np.zeros(N_MOTION)
    specific_motion(inputs, outputs, np.asarray(arm, dtype=float), motion)
    return motion


@given(
    st.tuples(angle, angle),
    st.tuples(triple, triple),
    st.tuples(acceleration, acceleration, acceleration),
    st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)),
    st.tuples(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2)),
)
def test_equals_the_second_derivative_of_the_point(euler, turning, linear, arm, road):
    rates, accelerations = turning
    bank, grade = road
    vertical = np.array(
        [math.sin(grade), math.sin(bank) * math.cos(grade), math.cos(bank) * math.cos(grade)]
    )

    def attitude(t):
        """In the heading axes of t = 0; they turn about the vertical, bank and grade are held."""
        roll, pitch, yaw = (
            angle + rate * t + acc * t * t / 2
            for angle, rate, acc in zip((*euler, 0.0), rates, accelerations, strict=True)
        )
        heading = Rotation.from_rotvec(yaw * vertical / vertical[2])
        return heading * Rotation.from_euler("YX", [pitch, roll])

    def point(t):
        return np.array(linear) * t * t / 2 + attitude(t).apply(arm)

    step = 1e-4
    inertial = (point(step) - 2 * point(0.0) + point(-step)) / step**2
    force = attitude(0.0).inv().apply(inertial + vertical * GRAVITY)
    turn = (attitude(-step).inv() * attitude(step)).as_rotvec() / (2 * step)

    inputs = np.zeros(ports.N_INPUTS)
    inputs[ports.BANK], inputs[ports.GRADE] = bank, grade
    outputs = np.zeros(ports.N_OUTPUTS)
    outputs[[ports.ROLL, ports.PITCH]] = euler
    outputs[[ports.ROLL_RATE, ports.PITCH_RATE, ports.YAW_RATE]] = rates
    outputs[[ports.ROLL_ACC, ports.PITCH_ACC, ports.YAW_ACC]] = accelerations
    outputs[ports.BODY_ACC : ports.BODY_ACC + 3] = linear
    motion = motion_of(inputs, outputs, arm)
    np.testing.assert_allclose(motion[RATE : RATE + 3], turn, atol=1e-5)
    np.testing.assert_allclose(motion[FORCE : FORCE + 3], force, atol=2e-5)


def test_parked_on_a_bank_reads_gravity_of_bank_and_roll():
    inputs, outputs = np.zeros(ports.N_INPUTS), np.zeros(ports.N_OUTPUTS)
    inputs[ports.BANK], outputs[ports.ROLL] = 0.1, 0.05
    motion = motion_of(inputs, outputs, [0.3, 0.1, -0.2])
    assert motion[FORCE + 1] == pytest.approx(GRAVITY * math.sin(0.15))


def test_left_turn_reads_left_and_a_rolled_body_more():
    inputs, outputs = np.zeros(ports.N_INPUTS), np.zeros(ports.N_OUTPUTS)
    outputs[ports.BODY_ACC + 1] = 4.0
    level = motion_of(inputs, outputs, [0, 0, 0])[FORCE + 1]
    outputs[ports.ROLL] = 0.05
    assert level == pytest.approx(4.0)
    assert motion_of(inputs, outputs, [0, 0, 0])[FORCE + 1] == pytest.approx(
        4.0 * math.cos(0.05) + GRAVITY * math.sin(0.05)
    )


def test_roll_gyro_sees_the_pitched_body_turn():
    inputs, outputs = np.zeros(ports.N_INPUTS), np.zeros(ports.N_OUTPUTS)
    outputs[ports.PITCH], outputs[ports.YAW_RATE] = 0.02, 0.5
    assert motion_of(inputs, outputs, [0, 0, 0])[RATE] == pytest.approx(-0.5 * math.sin(0.02))
