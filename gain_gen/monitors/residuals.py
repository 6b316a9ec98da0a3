"""The residuals of a car: balances that are zero where the linear car and all sensors are right.

All residuals are moments in N·m, that of heave a force in N: the lateral acceleration counts by
m h, a roll rate by the roll damping.
"""

from dataclasses import replace
from functools import partial
from math import inf, pi, sin

from canroll.gain_gen.models.task import Task
from canroll.gain_gen.monitors.bank import (
    DERIVATIVE,
    DIRECT,
    FADING,
    INTEGRAL,
    LOW_PASS,
    MEAN,
    STEP,
    Bank,
    Residual,
    ResidualPart,
    Term,
    low_pass_of,
)
from canroll.gain_gen.monitors.linear_car import (
    Car,
    axle_forces,
    blown,
    car_of,
    deviation,
    effective_inertia,
    lifting,
    off_stops,
    rolled,
    steering_deviation,
    tilted,
)
from canroll.gain_gen.monitors.noise import FASTEST, floor, late, raised
from canroll.gain_gen.monitors.shares import of_axles
from canroll.gain_gen.monitors.uncertainty import NOMINAL, Uncertainty, vertices
from canroll.vehicles import GRAVITY, Vehicle

SLOW, FAST, AXLES = 0.0125, 0.8, 0.2
"""Corners of the washouts, Hz: of the body twice, of the axles."""
LATERAL_TIME, GYRO_TIME, HEAVE_TIME = 0.08, 0.05, 1.0
"""How long without a break, s; of the body two time constants of the low-pass and a tick."""
MAY_BE_WRONG = "lateral force that may be wrong"
SLOWEST = 20.0
"""Speed above which a bump is shorter than the axles' time: both axles have passed it, m/s."""
LINEAR = 5.0
"""Lateral acceleration by yaw rate or steering up to which tyres are linear, m/s²: half of what a
dry road gives."""


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
    if task.observer != "reference":
        builder.lateral()
        if gyro and suspension:
            builder.gyro(moments)
        if suspension and moments:
            if gyro:
                builder.body()
            builder.axles()
            if task.actuator == "suspension":
                builder.heave()
    return Bank(builder.parts, tuple(builder.residuals), builder.tick)


def lateral_gap(vehicle: Vehicle, box: Uncertainty, tick: float) -> tuple[float, float]:
    """Return by how much the lateral acceleration may differ from yaw rate × speed.

    m/s² by bank, sideslip and noise, and a share of it by the lean of the body.
    """
    car = car_of(vehicle)
    builder = Builder(car, box, tick)
    builder.lateral()
    names = ("mass", "height", "stiffness", "speed")
    share = max(abs(f.speed * tilted(car, f) - 1.0) for f in vertices(box, names))
    return builder.residuals[0].floor / car.arm, share


class Builder:
    """Parts and residuals in the order of addition; a residual names its parts."""

    def __init__(self, car: Car, box: Uncertainty, tick: float) -> None:
        self.car, self.box, self.tick = car, box, tick
        self.parts: dict[str, ResidualPart] = {}
        self.residuals: list[Residual] = []
        geometry = car.vehicle.geometry
        self.low_pass = low_pass_of(car.vehicle)
        self.body_time = 2.0 * self.low_pass + self.tick
        self.axle_time = geometry.wheelbase / SLOWEST
        self.on_road = min(lifting(car)) / (1.0 + box.height)

    def term(
        self,
        name: str,
        kind: str,
        gains: dict[str, float],
        sign: int,
        weight: float = 0.0,
        *,
        washout: float = 0.0,
        low_pass: float | None = None,
    ) -> Term:
        """Add a part, by default with the car's low-pass; return it as a term."""
        self.parts[name] = ResidualPart(name, kind, gains, washout, low_pass or self.low_pass)
        return Term(name, sign, weight)

    def residual(
        self,
        name: str,
        terms: list[Term],
        *,
        time: float,
        besides: float = 0.0,
        limit: float = inf,
        fading: float = 0.0,
    ) -> None:
        """Add a residual, its floor that of the noise and a constant ``besides``."""
        fading = fading or FADING * self.low_pass
        vehicle, box, tick = self.car.vehicle, self.box, self.tick
        noise = floor(self.parts, terms, vehicle=vehicle, box=box, tick=tick, time=time)
        noisy = raised(self.parts, terms, vehicle=vehicle, box=box, tick=tick, fading=fading)
        self.residuals.append(
            Residual(name, tuple(terms), noise + besides, time, limit, fading, noisy)
        )

    def strokes(self, gains: tuple[float, float], factor: float = 1.0) -> dict[str, float]:
        """Return gains of both axles' stroke rates from those of their roll rates."""
        tracks = self.car.tracks
        return {
            "stroke_front": factor * gains[0] / tracks[0],
            "stroke_rear": factor * gains[1] / tracks[1],
        }

    def body(self) -> None:
        """Add the balance of moments on the body: J p' + springs + dampers = m h a_y + moments.

        What its stops bear is in no residual: on them it does not hold.
        """
        car, box = self.car, self.box
        springs = car.stiffness * car.shares[0], car.stiffness * car.shares[1]
        inertia = deviation(lambda f: effective_inertia(car, f), box, ("mass", "height", "inertia"))
        side = deviation(lambda f: f.mass * f.height, box, ("mass", "height"))
        j = effective_inertia(car, NOMINAL) / self.low_pass
        lost = late(box, self.tick, SLOW)
        steps = "steps of the springs"
        self.term(steps, STEP, self.strokes(springs, lost), 0, low_pass=MEAN)
        delivered = {"moment_front": 1.0, "moment_rear": 1.0}
        limit = off_stops(car, box)
        for name, washout in (("slow", SLOW), ("fast", FAST)):
            term = partial(self.term, washout=washout)
            terms = [
                term(f"momentum, {name}", DERIVATIVE, {"roll_rate": j}, 1, inertia),
                term(f"springs, {name}", INTEGRAL, self.strokes(springs), 1, box.stiffness),
                term(f"dampers, {name}", DIRECT, self.strokes(car.dampers), 1, box.damping),
                term(f"side, {name}", DIRECT, {"lateral": car.arm}, -1, side),
                term(f"moments, {name}", DIRECT, delivered, -1, box.moment),
                Term(steps, 0, late(box, self.tick, washout) / lost),
            ]
            self.residual(
                f"body, {name}",
                terms,
                time=self.body_time,
                besides=blown(car.vehicle, box.wind, FASTEST),
                limit=limit,
            )

    def lateral(self) -> None:
        """Add the lateral acceleration against yaw rate × speed and against steering."""
        car, box = self.car, self.box
        names = ("mass", "height", "stiffness", "speed")
        gain, m = tilted(car, NOMINAL), car.arm
        apart = deviation(lambda f: f.speed * tilted(car, f), box, names)
        # by frames as they come, without the suspensions' low-pass
        term = partial(self.term, low_pass=LOW_PASS)
        steered = {"steered": gain * m}
        turn = [
            term("turn", DIRECT, {"turning": gain * m, "lateral": -m}, 1),
            term("turning", DIRECT, {"turning": gain * m}, 0, apart),
        ]
        steer = [
            term("steer", DIRECT, {**steered, "lateral": -m}, 1),
            term("steered", DIRECT, steered, 0, steering_deviation(car, box)),
            self.term("change of steering", DERIVATIVE, steered, 0, 1.0, low_pass=box.response),
        ]
        least, fading = (box.sideslip + GRAVITY * sin(box.bank)) * m, FADING * LOW_PASS
        for name, terms in (("turn", turn), ("steer", steer)):
            self.residual(
                name, terms, time=LATERAL_TIME, besides=least, limit=LINEAR, fading=fading
            )

    def gyro(self, moments: bool) -> None:
        """Add the roll rate against that of each suspension.

        The body rolls as they do and as their tyres do: by a share of it in a curve, at once by
        what changed moments compress of them. What one axle meets alone makes both suspensions
        roll apart by as much.
        """
        car, box = self.car, self.box
        damping = car.vehicle.design.roll_damping
        rate = self.term("roll rate", DIRECT, {"roll_rate": damping}, 0)
        per = [-damping * (rolled(car, axle, NOMINAL) / car.tracks[axle]) for axle in range(2)]
        apart = {"stroke_front": -per[0], "stroke_rear": per[1]}
        terms = [self.term("suspensions apart", DIRECT, apart, 0, 1.0)]
        if moments:
            tyres = damping / self.low_pass
            moved = {"moment_front": tyres / car.tyres[0], "moment_rear": tyres / car.tyres[1]}
            terms.append(self.term("moments on the tyres", DERIVATIVE, moved, 0, 1.0))
        for axle, name in enumerate(("front", "rear")):
            gains = {"roll_rate": damping, f"stroke_{name}": per[axle]}
            difference = self.term(f"gyro less {name}", DIRECT, gains, 1)
            weight = deviation(partial(rolled, car, axle), box, ("tyre", "stiffness"))
            self.residual(
                f"gyro, {name}",
                [difference, replace(rate, weight=weight), *terms],
                time=GYRO_TIME,
                besides=box.bank_rate * damping,
                limit=self.on_road,
            )

    def axles(self) -> None:
        """Add the tyres of one axle against the other's, as moments on the front's.

        The body is rigid in roll: its suspensions roll apart only as their tyres do, which bear
        springs, dampers and moment of their axle and the lateral force at its roll centre. On a
        road the axles differ by what it rises between them, which their rates apart make within the
        time of a bump.
        """
        car, box = self.car, self.box
        vehicle, scale = car.vehicle, car.scale
        springs = [
            factor * car.stiffness * share for factor, share in zip(scale, car.shares, strict=True)
        ]
        tyre = car.tyres[0]
        lateral, yaw = axle_forces(vehicle, scale)
        by_lateral, by_moment = of_axles(car, box)
        term, apart = partial(self.term, washout=AXLES), (springs[0] + tyre, -springs[1] - tyre)
        damped = self.strokes((car.dampers[0], -scale[1] * car.dampers[1]))
        turned = {"yaw_rate": yaw / self.low_pass}
        terms = [
            term("suspensions and tyres apart", INTEGRAL, self.strokes(apart), 1),
            term("dampers apart", DIRECT, damped, 1),
            term("forces at the roll centres", DIRECT, {"lateral": lateral}, 1),
            self.term("yaw at the roll centres", DERIVATIVE, turned, 1),
            term("front moment", DIRECT, {"moment_front": 1.0}, -1, by_moment),
            term("rear moment", DIRECT, {"moment_rear": scale[1]}, 1, by_moment),
            term(MAY_BE_WRONG, DIRECT, {"lateral": by_lateral}, 0, 1.0),
            term("rate apart", DIRECT, self.strokes(apart, box.bump), 0, 1.0),
        ]
        self.residual(
            "axles", terms, time=self.axle_time, limit=self.on_road, fading=1.0 / (pi * AXLES)
        )

    def heave(self) -> None:
        """Add what the springs carry: the body's weight, however it moves, and hills (N)."""
        box, suspension = self.box, self.car.vehicle.suspension
        rates = {
            "heave_front": suspension.spring_rate_front,
            "heave_rear": suspension.spring_rate_rear,
        }
        factor = late(box, self.tick, SLOW)
        steps = {name: factor * rate for name, rate in rates.items()}
        terms = [
            self.term("carried by the springs", INTEGRAL, rates, 1, washout=SLOW),
            self.term("steps of heave", STEP, steps, 0, 1.0, low_pass=MEAN),
        ]
        # what softer springs carry makes them give way more than stiffness as designed for explains
        mass = (1.0 + box.mass) * self.car.vehicle.design.sprung_mass / (1.0 - box.stiffness)
        self.residual("heave", terms, time=HEAVE_TIME, besides=box.hill * mass)
