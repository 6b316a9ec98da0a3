"""The residuals of a car: balances that are zero where the linear car and all sensors are right.

Each gain is written once as a function of a point of the box of uncertainties, so that the corners
of the box say what it may be wrong by. All residuals are moments in N·m, that of heave a force in
N: the lateral acceleration counts by m h, a roll rate by the roll damping.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from math import sin, sqrt

from firmware.monitors.residuals import ROUND
from gain_gen.models.task import Task
from gain_gen.monitors.bank import (
    DERIVATIVE,
    DIRECT,
    INTEGRAL,
    MEAN,
    STEP,
    Bank,
    Part,
    Ranges,
    Residual,
    Term,
)
from gain_gen.monitors.noise import OF_RATE, OF_STEPS, floor, walk
from gain_gen.monitors.signatures import signatures
from gain_gen.monitors.uncertainty import NOMINAL, Factors, Uncertainty, vertices
from vehicles import GRAVITY, Vehicle
from vehicles.roll_stiffness import axle_roll_shares, steady_roll, suspension_roll_stiffness

LOW_PASS = 0.05
"""Time constant of the low-pass, s."""
SLOW, FAST, AXLES = 0.0125, 0.8, 0.2
"""Corners of the washouts, Hz: of the body twice, of the axles."""
HOLD, BODY_HOLD = 0.4, 0.2
"""Time for which a threshold remembers, s: a kerb is under both axles, or the stops are left, and
gone from the filters; of the body off its stops until what has changed has counted."""
LATERAL_TIME, OPPOSITE_TIME, BIAS_TIME, GYRO_TIME, HEAVE_TIME = 0.08, 0.6, 0.1, 0.05, 1.0
"""How long without a break, s; of the body two time constants of the low-pass and a tick."""
SLOWEST = 20.0
"""Speed above which a bump is shorter than the axles' time: both axles have passed it, m/s."""
LINEAR = 5.0
"""Lateral acceleration by yaw rate or steering up to which tyres are linear, m/s²: half of what a
dry road gives."""
OPPOSITE = 1.5
"""Lateral acceleration and yaw rate × speed that may not oppose, m/s²."""
BIAS_MAX = 0.05
"""Largest plausible gyro bias, rad/s."""

Gain = Callable[[Factors], float]


@dataclass(frozen=True, slots=True)
class Car:
    """What the gains are made of; pairs are (front, rear)."""

    vehicle: Vehicle
    stiffness: float
    shares: tuple[float, float]
    tracks: tuple[float, float]
    dampers: tuple[float, float]
    tyres: tuple[float, float]

    @property
    def arm(self) -> float:
        """m h, kg·m."""
        return self.vehicle.design.roll_arm

    @property
    def scale(self) -> tuple[float, float]:
        """Factors that make a moment on the axle's tyres one on the front's."""
        return 1.0, self.tyres[0] / self.tyres[1]


def car_of(vehicle: Vehicle) -> Car:
    """Return the car of a vehicle."""
    geometry, share = vehicle.geometry, vehicle.suspension.roll_damping_front_share
    halves = geometry.half_track_front, geometry.half_track_rear
    tyres = [2.0 * vehicle.tyre.vertical_stiffness * half**2 for half in halves]
    damping = vehicle.design.roll_damping
    return Car(
        vehicle,
        suspension_roll_stiffness(vehicle),
        axle_roll_shares(vehicle),
        (2.0 * halves[0], 2.0 * halves[1]),
        (share * damping, (1.0 - share) * damping),
        (tyres[0], tyres[1]),
    )


def effective_inertia(car: Car, f: Factors) -> float:
    """Return J = I_G − m h z: the roll inertia where a_y is that of the inertial unit.

    The unit, z above the CG, moves sideways with the body, so that its acceleration is not that of
    the roll axis and m h a_y holds a part of the body's inertia. It tilts with the body as well and
    measures the weight's component, so that neither gravity nor a bank enters.
    """
    roll, up = car.vehicle.design, car.vehicle.sensors.imu_position[2]
    return f.inertia * roll.inertia_about_cg - f.mass * f.height * roll.roll_arm * up


def tilted(car: Car, f: Factors) -> float:
    """Return 1 + g φ/a_y: what the unit on a leaning body measures per lateral acceleration."""
    roll = car.vehicle.design
    arm = f.mass * f.height * roll.roll_arm
    return 1.0 + GRAVITY * arm / (f.stiffness * roll.roll_stiffness - arm * GRAVITY)


def rolled(car: Car, axle: int, f: Factors) -> float:
    """Return the body's roll per roll of an axle's suspension: the rest is that of its tyres."""
    vehicle = car.vehicle
    stiffness = f.tyre * vehicle.tyre.vertical_stiffness
    vehicle = replace(vehicle, tyre=replace(vehicle.tyre, vertical_stiffness=stiffness))
    roll = steady_roll(vehicle, f.stiffness * car.stiffness)
    return roll[0] / (roll[0] - roll[1 + axle])


def steered(car: Car, f: Factors, speed: float, front: float, rear: float) -> float:
    """Return the steady lateral acceleration per road-wheel angle of a car with other tyres."""
    tyre = car.vehicle.tyre
    other = replace(
        tyre,
        cornering_stiffness_front=front * tyre.cornering_stiffness_front,
        cornering_stiffness_rear=rear * tyre.cornering_stiffness_rear,
    )
    return tilted(car, f) * replace(car.vehicle, tyre=other).lateral_gain(speed)


def lifting(car: Car) -> tuple[float, float]:
    """Return the lateral accelerations (m/s²) at which the inner front and rear wheel lift."""
    vehicle = car.vehicle
    geometry = vehicle.geometry
    roll = steady_roll(vehicle, car.stiffness)
    others = geometry.cg_to_rear_axle, geometry.cg_to_front_axle
    front, rear = (
        vehicle.total_mass * GRAVITY * other / geometry.wheelbase * track / (2.0 * tyre * tilt)
        for other, track, tyre, tilt in zip(others, car.tracks, car.tyres, roll[1:], strict=True)
    )
    return front, rear


def free_lean(car: Car) -> float:
    """Return the roll (rad) of the suspension at which the body first leans on its stops.

    Clearances are those of the car as it stands, with its load.
    """
    suspension = car.vehicle.suspension
    clearance = min(suspension.bump_clearance, suspension.rebound_clearance)
    return 2.0 * clearance / max(car.tracks)


def off_stops(car: Car, box: Uncertainty) -> float:
    """Return the lateral acceleration (m/s²) below which no car of the box leans on its stops."""
    roll = steady_roll(car.vehicle, car.stiffness)
    worst = (1.0 + box.mass) * (1.0 + box.height) / (1.0 - box.stiffness)
    return free_lean(car) / ((roll[0] - min(roll[1:])) * worst)


def deviation(gain: Gain, box: Uncertainty, names: tuple[str, ...]) -> float:
    """Return the largest deviation of a gain over the box, as share of its nominal value."""
    nominal = gain(NOMINAL)
    return max(abs(gain(corner) / nominal - 1.0) for corner in vertices(box, names))


def steering_deviation(car: Car, box: Uncertainty) -> float:
    """Return that of the lateral acceleration by steering, for tyres of each axle by themselves."""
    nominal = {speed: steered(car, NOMINAL, speed, 1.0, 1.0) for speed in (10.0, 20.0, 30.0)}
    low, high = 1.0 - box.cornering, 1.0 + box.cornering
    return max(
        abs(steered(car, corner, speed, front, rear) / nominal[speed] - 1.0)
        for speed in nominal
        for front, rear in ((low, high), (high, low))
        for corner in vertices(box, ("mass", "height", "stiffness"))
    )


def bank_of(task: Task, box: Uncertainty, *, suspension: bool, moments: bool) -> Bank:
    """Return the bank of residuals of a design.

    Args:
        task: of the design.
        box: what is not known.
        suspension: whether stroke rates are received.
        moments: whether the actuators' commands are moments, and reported.
    """
    gyro = task.observer not in ("acceleration", "acceleration_propagated", "reference")
    builder = Builder(car_of(task.vehicle), box, task.tick)
    lean = ""
    if task.observer != "reference":
        builder.lateral()
        if gyro:
            builder.bias()
            if suspension:
                builder.gyro(moments)
        if suspension and moments:
            if gyro:
                lean = builder.body()
            builder.axles()
            if task.actuator == "suspension":
                builder.heave()
    bits = {residual.bit for residual in builder.residuals}
    naming = max(0.0, builder.axle_time - builder.body_time)
    car = builder.car
    ranges = Ranges(
        LINEAR, builder.on_road, off_stops(car, box), lean, car.stiffness * free_lean(car)
    )
    return Bank(
        builder.parts, tuple(builder.residuals), signatures(bits, naming), ranges, builder.tick
    )


class Builder:
    """Parts and residuals as they are added; a residual names the parts it is made of."""

    def __init__(self, car: Car, box: Uncertainty, tick: float) -> None:
        self.car, self.box, self.sample, self.tick = car, box, tick, ROUND * tick
        self.parts: dict[str, Part] = {}
        self.residuals: list[Residual] = []
        geometry = car.vehicle.geometry
        self.body_time = 2.0 * LOW_PASS + self.tick
        self.axle_time = geometry.wheelbase / SLOWEST
        self.on_road = min(lifting(car)) / (1.0 + box.height)

    def part(self, *args: str, gains: dict[str, float], washout: float = 0.0, **more: float) -> str:
        """Add a part of a name and kind; return its name."""
        name, kind = args
        self.parts[name] = Part(name, kind, gains, washout, more.get("low_pass", LOW_PASS))
        return name

    def residual(
        self,
        name: str,
        bit: str,
        terms: list[Term],
        *,
        time: float,
        ranges: tuple[str, ...] = (),
        **more: float,
    ) -> None:
        """Add a residual, its floor that of the noise and a constant ``besides``."""
        noise = floor(
            self.parts,
            terms,
            vehicle=self.car.vehicle,
            box=self.box,
            tick=self.tick,
            time=time,
        )
        least = noise + more.get("besides", 0.0)
        hold = more.get("hold", HOLD)
        self.residuals.append(Residual(name, bit, tuple(terms), least, time, hold, ranges))

    def strokes(self, gains: tuple[float, float], factor: float = 1.0) -> dict[str, float]:
        """Return gains of both axles' stroke rates from those of their roll rates."""
        tracks = self.car.tracks
        return {
            "stroke_front": factor * gains[0] / tracks[0],
            "stroke_rear": factor * gains[1] / tracks[1],
        }

    def late(self, washout: float) -> float:
        """Return how far an integral walks for samples that are lost, per mean step."""
        integral = Part("", INTEGRAL, {}, washout)
        return walk(integral, self.box, self.sample, OF_STEPS * sqrt(self.box.late))

    def body(self) -> str:
        """Add the balance of moments on the body: J p' + springs + dampers = m h a_y + moments.

        Return the name of the springs' part, by which the body leans. What its stops bear is in no
        residual: on them it is not judged.
        """
        car, box = self.car, self.box
        springs = car.stiffness * car.shares[0], car.stiffness * car.shares[1]
        inertia = deviation(lambda f: effective_inertia(car, f), box, ("mass", "height", "inertia"))
        side = deviation(lambda f: f.mass * f.height, box, ("mass", "height"))
        j = effective_inertia(car, NOMINAL) / LOW_PASS
        late = self.late(SLOW)
        steps = self.part(
            "steps of the springs", STEP, gains=self.strokes(springs, late), low_pass=MEAN
        )
        for name, washout, hold in (("slow", SLOW, BODY_HOLD), ("fast", FAST, HOLD)):
            terms = [
                Term(
                    self.part(
                        f"momentum, {name}", DERIVATIVE, gains={"roll_rate": j}, washout=washout
                    ),
                    1,
                    inertia,
                ),
                Term(
                    self.part(
                        f"springs, {name}", INTEGRAL, gains=self.strokes(springs), washout=washout
                    ),
                    1,
                    box.stiffness,
                ),
                Term(
                    self.part(
                        f"dampers, {name}",
                        DIRECT,
                        gains=self.strokes(car.dampers),
                        washout=washout,
                    ),
                    1,
                    box.damping,
                ),
                Term(
                    self.part(f"side, {name}", DIRECT, gains={"lateral": car.arm}, washout=washout),
                    -1,
                    side,
                ),
                Term(
                    self.part(
                        f"moments, {name}",
                        DIRECT,
                        gains={"moment_front": 1.0, "moment_rear": 1.0},
                        washout=washout,
                    ),
                    -1,
                    box.moment,
                ),
                Term(
                    steps,
                    0,
                    self.late(washout) / late,
                ),
            ]
            self.residual(
                f"body, {name}",
                "body",
                terms,
                time=self.body_time,
                hold=hold,
                ranges=("off_stops",),
            )
        return "springs, slow"

    def lateral(self) -> None:
        """Add the lateral acceleration against yaw rate × speed and against steering."""
        car, box = self.car, self.box
        names = ("mass", "height", "stiffness", "speed")
        gain, m = tilted(car, NOMINAL), car.arm
        apart = deviation(lambda f: f.speed * tilted(car, f), box, names)
        turn = self.part("turn", DIRECT, gains={"turning": gain * m, "lateral": -m})
        turning = self.part("turning", DIRECT, gains={"turning": gain * m})
        both = self.part("turning and lateral", DIRECT, gains={"turning": m, "lateral": m})
        steer = self.part("steer", DIRECT, gains={"steered": gain * m, "lateral": -m})
        angle = self.part("steered", DIRECT, gains={"steered": gain * m})
        change = self.part(
            "change of steering", DERIVATIVE, gains={"steered": gain * m}, low_pass=box.response
        )
        slip, bank = box.sideslip * m, GRAVITY * sin(box.bank) * m
        terms = [Term(turn, 1, 0.0), Term(turning, 0, apart)]
        self.residual("turn", "turn", terms, time=self.body_time, besides=slip, ranges=("linear",))
        self.residual(
            "turn, bank", "far", terms, time=LATERAL_TIME, besides=slip + bank, ranges=("linear",)
        )
        terms = [
            Term(steer, 1, 0.0),
            Term(angle, 0, steering_deviation(car, box)),
            Term(change, 0, 1.0),
        ]
        self.residual("steer", "steer", terms, time=LATERAL_TIME, besides=slip, ranges=("linear",))
        terms = [Term(turn, 1, 0.0), Term(both, 0, 1.0)]
        self.residual("opposite", "opposite", terms, time=OPPOSITE_TIME, besides=2.0 * OPPOSITE * m)

    def bias(self) -> None:
        """Add the observer's gyro bias against the largest plausible one."""
        damping = self.car.vehicle.design.roll_damping
        part = self.part("gyro bias", DIRECT, gains={"gyro_bias": damping}, low_pass=self.tick)
        self.residual(
            "bias", "bias", [Term(part, 1, 0.0)], time=BIAS_TIME, besides=0.98 * BIAS_MAX * damping
        )

    def gyro(self, moments: bool) -> None:
        """Add the roll rate against that of each suspension.

        The body rolls as they do and as their tyres do: by a share of it in a curve, at once by
        what changed moments compress of them. What one axle meets alone makes both suspensions
        roll apart by as much.
        """
        car, box = self.car, self.box
        damping = car.vehicle.design.roll_damping
        rate = self.part("roll rate", DIRECT, gains={"roll_rate": damping})
        per = [rolled(car, axle, NOMINAL) / car.tracks[axle] for axle in range(2)]
        apart = self.part(
            "suspensions apart",
            DIRECT,
            gains={"stroke_front": damping * per[0], "stroke_rear": -damping * per[1]},
        )
        terms = [Term(apart, 0, 1.0)]
        if moments:
            tyres = damping / LOW_PASS
            moved = self.part(
                "moments on the tyres",
                DERIVATIVE,
                gains={
                    "moment_front": tyres / car.tyres[0],
                    "moment_rear": tyres / car.tyres[1],
                },
            )
            terms.append(Term(moved, 0, 1.0))
        for axle, name in enumerate(("front", "rear")):
            difference = self.part(
                f"gyro less {name}",
                DIRECT,
                gains={"roll_rate": damping, f"stroke_{name}": -damping * per[axle]},
            )
            weight = deviation(partial(rolled, car, axle), box, ("tyre", "stiffness"))
            self.residual(
                f"gyro, {name}",
                f"gyro {name}",
                [Term(difference, 1, 0.0), Term(rate, 0, weight), *terms],
                time=GYRO_TIME,
                besides=box.bank_rate * damping,
                ranges=("on_road",),
            )

    def axles(self) -> None:
        """Add the tyres of one axle against the other's, as moments on the front's.

        The body is rigid in roll: its suspensions roll apart only as their tyres do, which bear
        springs, dampers and moment of their axle and the lateral force at its roll centre.
        """
        car, box = self.car, self.box
        vehicle, scale = car.vehicle, car.scale
        springs = [
            factor * car.stiffness * share for factor, share in zip(scale, car.shares, strict=True)
        ]
        tyre = car.tyres[0]
        lateral, yaw, carried = axle_forces(vehicle, scale)
        stretch = self.part(
            "suspensions and tyres apart",
            INTEGRAL,
            gains=self.strokes((springs[0] + tyre, -springs[1] - tyre)),
            washout=AXLES,
        )
        bump = self.part(
            "rate apart", DIRECT, gains=self.strokes((tyre, -tyre), box.bump), washout=AXLES
        )
        damped = self.part(
            "dampers apart",
            DIRECT,
            gains=self.strokes((car.dampers[0], -scale[1] * car.dampers[1])),
            washout=AXLES,
        )
        side = self.part(
            "forces at the roll centres", DIRECT, gains={"lateral": lateral}, washout=AXLES
        )
        centres = self.part(
            "roll centres", DIRECT, gains={"lateral": carried * box.roll_centre}, washout=AXLES
        )
        front = self.part("front moment", DIRECT, gains={"moment_front": 1.0}, washout=AXLES)
        rear = self.part("rear moment", DIRECT, gains={"moment_rear": scale[1]}, washout=AXLES)
        turned = self.part(
            "yaw at the roll centres", DERIVATIVE, gains={"yaw_rate": yaw / LOW_PASS}
        )
        road = self.part(
            "steps apart",
            STEP,
            gains=self.strokes(
                (tyre, -tyre), walk(Part("", INTEGRAL, {}, AXLES), box, self.sample, OF_RATE)
            ),
            low_pass=MEAN,
        )
        terms = [
            Term(stretch, 1, max(box.tyre, box.stiffness)),
            Term(bump, 0, 1.0),
            Term(damped, 1, box.damping),
            Term(side, 1, box.mass),
            Term(centres, 0, 1.0),
            Term(front, -1, box.moment),
            Term(rear, 1, box.moment),
            Term(turned, 1, box.mass),
            Term(road, 0, 1.0),
        ]
        self.residual("axles", "axles", terms, time=self.axle_time, ranges=("on_road",))

    def heave(self) -> None:
        """Add what the springs carry: the body's weight, however it moves, and hills (N)."""
        box, suspension = self.box, self.car.vehicle.suspension
        rates = {
            "heave_front": suspension.spring_rate_front,
            "heave_rear": suspension.spring_rate_rear,
        }
        carried = self.part("carried by the springs", INTEGRAL, gains=rates, washout=SLOW)
        factor = self.late(SLOW)
        steps = self.part(
            "steps of heave",
            STEP,
            gains={name: factor * rate for name, rate in rates.items()},
            low_pass=MEAN,
        )
        mass = (1.0 + box.mass) * self.car.vehicle.design.sprung_mass
        self.residual(
            "heave",
            "heave",
            [Term(carried, 1, box.stiffness), Term(steps, 0, 1.0)],
            time=HEAVE_TIME,
            besides=box.hill * mass,
        )


def axle_forces(vehicle: Vehicle, scale: tuple[float, float]) -> tuple[float, float, float]:
    """Return what lateral (kg·m) and yaw acceleration (kg·m²) make of the axles' difference.

    The third number is what the lateral acceleration makes of it per height of both roll centres,
    moved apart (kg).
    """
    geometry, mass = vehicle.geometry, vehicle.mass
    heights = geometry.roll_centre_height_front, geometry.roll_centre_height_rear
    unsprung = mass.unsprung_front, mass.unsprung_rear
    moments, carried = [], 0.0
    for axle, other in enumerate((geometry.cg_to_rear_axle, geometry.cg_to_front_axle)):
        sprung = vehicle.total_mass * other / geometry.wheelbase - unsprung[axle]
        carried += scale[axle] * sprung
        moments.append(sprung * heights[axle] + unsprung[axle] * vehicle.tyre.radius)
    arm = (heights[0] + scale[1] * heights[1]) / geometry.wheelbase
    return moments[0] - scale[1] * moments[1], arm * mass.yaw_inertia, carried
