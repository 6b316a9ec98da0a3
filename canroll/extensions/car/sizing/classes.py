"""Classes of vehicles: ratios by which a vehicle's numbers follow from its mass and size.

Of a ratio that was measured on many vehicles the spread is two standard deviations.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace

from canroll.errors import UnknownNameError


@dataclass(frozen=True, slots=True)
class Ratio:
    """A usual value, its relative spread, and where both come from."""

    value: float
    spread: float
    source: str

    @property
    def low(self) -> float:
        """Lower end of the spread."""
        return self.value * (1.0 - self.spread)

    @property
    def high(self) -> float:
        """Upper end of the spread."""
        return self.value * (1.0 + self.spread)

    def __str__(self) -> str:
        return f"{self.value:g} ±{100 * self.spread:.0f} %"


MEASURED = "Ford Escort, BMW 320i and VW Vanagon measured by NHTSA, of CommonRoad's vehicle models"
RATED = "measured by NHTSA for its rollover ratings"
HEAVIEST = 5000.0
"""Mass above which a vehicle is none of these classes, kg: the heaviest one measured has 3.3 t."""
GILLESPIE = "Gillespie, Fundamentals of Vehicle Dynamics"
PACEJKA = "Pacejka, Tire and Vehicle Dynamics"


@dataclass(frozen=True, slots=True)
class VehicleClass:
    """A class of vehicles.

    Attributes:
        title: of the class.
        base: the preset of which sensors, actuators and the shapes of dampers and tyres are taken.
        front_share: of the weight at rest.
        cg_height: of the centre of gravity over the vehicle's height.
        width: over the mean track.
        unsprung: share of the mass.
        roll_gyration: radius of gyration of the body over the width.
        yaw_index: yaw inertia over mass × distances of both axles from the centre of gravity.
        pitch_index: pitch inertia of the body over the yaw inertia.
        ride_front: frequency of the body on one front spring, Hz.
        ride_rear: on one rear spring, Hz.
        bars: roll stiffness of springs and bars over that of the springs.
        front_bar: the front bar's share of both bars.
        front_damping: the front axle's share of the roll damping.
        roll_damping: damping ratio in roll.
        roll_centre_front: height over that of the centre of gravity.
        roll_centre_rear: the same at the rear axle.
        cornering_front: cornering stiffness of an axle over its load, compliance included, 1/rad.
        cornering_rear: the same at the rear axle.
        deflection: of a tyre under its load, over its radius.
        longitudinal: longitudinal stiffness of a tyre over its load.
        wheel_gyration: wheel inertia over its unsprung mass × radius².
        radius: of a tyre, m.
        roll_gradient: usual range, °/g, an estimate.
        understeer: the same of the understeer gradient, at the road wheels.
        drives: front share by the driven axles: front, rear or all.
    """

    title: str
    base: str
    front_share: Ratio
    cg_height: Ratio
    width: Ratio
    unsprung: Ratio
    roll_gyration: Ratio
    yaw_index: Ratio
    pitch_index: Ratio
    ride_front: Ratio
    ride_rear: Ratio
    bars: Ratio
    front_bar: Ratio
    front_damping: Ratio
    roll_damping: Ratio
    roll_centre_front: Ratio
    roll_centre_rear: Ratio
    cornering_front: Ratio
    cornering_rear: Ratio
    deflection: Ratio
    longitudinal: Ratio
    wheel_gyration: Ratio
    radius: Ratio
    roll_gradient: tuple[float, float]
    understeer: tuple[float, float]
    drives: Mapping[str, Ratio] = field(default_factory=dict)


RATIOS = tuple(entry.name for entry in fields(VehicleClass) if entry.type is Ratio)
"""Names of the ratios of a class."""

_CORNERING = f"{PACEJKA}, and {GILLESPIE}: passenger radials, less for steering compliance"
_COMMON = {
    "width": Ratio(1.18, 0.03, MEASURED),
    "yaw_index": Ratio(1.0, 0.12, MEASURED),
    "pitch_index": Ratio(0.88, 0.03, MEASURED),
    "front_bar": Ratio(0.85, 0.2, MEASURED),
    "front_damping": Ratio(0.5, 0.08, MEASURED),
    "roll_damping": Ratio(0.3, 0.25, MEASURED),
    "deflection": Ratio(0.048, 0.2, MEASURED),
    "longitudinal": Ratio(20.0, 0.4, PACEJKA),
    "wheel_gyration": Ratio(0.4, 0.25, MEASURED),
}
CLASSES = {
    "car": VehicleClass(
        title="passenger car",
        base="sedan_320i",
        front_share=Ratio(0.58, 0.12, "estimate: rear-wheel to front-wheel drive"),
        cg_height=Ratio(0.376, 0.06, f"360 cars of 2001 to 2021 {RATED}"),
        unsprung=Ratio(0.11, 0.15, MEASURED),
        roll_gyration=Ratio(0.285, 0.15, f"{MEASURED}; Toyota Yaris by CCSA: 0.33"),
        ride_front=Ratio(1.4, 0.2, MEASURED),
        ride_rear=Ratio(1.6, 0.2, MEASURED),
        bars=Ratio(1.27, 0.2, MEASURED),
        roll_centre_front=Ratio(0.1, 1.0, f"{GILLESPIE}: independent front suspension"),
        roll_centre_rear=Ratio(0.2, 0.6, f"{GILLESPIE}: independent rear suspension"),
        cornering_front=Ratio(12.0, 0.3, _CORNERING),
        cornering_rear=Ratio(16.0, 0.3, _CORNERING),
        radius=Ratio(0.315, 0.08, "tyres from 185/65 R15 to 245/40 R19"),
        roll_gradient=(3.0, 7.0),
        understeer=(0.0, 4.0),
        drives={
            "front": Ratio(0.61, 0.04, f"19 cars of 2003 to 2005 {RATED}"),
            "rear": Ratio(0.535, 0.08, f"Mazda RX-8 {RATED}; BMW 320i of CommonRoad"),
            "all": Ratio(0.54, 0.08, f"Subaru Outback {RATED}; BMW M8 of ROADVIEW"),
        },
        **_COMMON,
    ),
    "suv": VehicleClass(
        title="sport utility vehicle",
        base="suv_2020",
        front_share=Ratio(0.55, 0.1, f"22 SUVs of 2003 to 2005 {RATED}"),
        cg_height=Ratio(0.388, 0.05, f"405 SUVs of 2001 to 2021 {RATED}"),
        unsprung=Ratio(0.12, 0.2, "estimate: heavier wheels than those of a car"),
        roll_gyration=Ratio(0.31, 0.08, "estimate: between car and van"),
        ride_front=Ratio(1.3, 0.2, f"{GILLESPIE}: ride chapter"),
        ride_rear=Ratio(1.5, 0.2, f"{GILLESPIE}: ride chapter"),
        bars=Ratio(1.35, 0.2, MEASURED),
        roll_centre_front=Ratio(0.1, 1.0, f"{GILLESPIE}: independent front suspension"),
        roll_centre_rear=Ratio(0.2, 0.6, f"{GILLESPIE}: independent rear suspension"),
        cornering_front=Ratio(10.0, 0.3, _CORNERING),
        cornering_rear=Ratio(13.0, 0.3, _CORNERING),
        radius=Ratio(0.36, 0.07, "tyres from 215/65 R17 to 275/45 R21"),
        roll_gradient=(3.0, 8.0),
        understeer=(0.0, 5.0),
        drives={
            "front": Ratio(0.58, 0.06, f"3 SUVs of 2003 to 2005 {RATED}"),
            "rear": Ratio(0.53, 0.06, f"7 SUVs of 2003 to 2005 {RATED}"),
            "all": Ratio(0.55, 0.08, f"12 SUVs of 2003 to 2005 {RATED}"),
        },
        **_COMMON,
    ),
    "van": VehicleClass(
        title="van",
        base="van_real",
        front_share=Ratio(0.53, 0.12, "estimate: laden to empty"),
        cg_height=Ratio(0.367, 0.1, f"27 vans of 2001 to 2021 {RATED}"),
        unsprung=Ratio(0.13, 0.25, "estimate: more than a car with a solid rear axle"),
        roll_gyration=Ratio(0.325, 0.08, MEASURED),
        ride_front=Ratio(1.5, 0.2, MEASURED),
        ride_rear=Ratio(1.7, 0.25, MEASURED),
        bars=Ratio(1.45, 0.2, MEASURED),
        roll_centre_front=Ratio(0.12, 1.0, f"{GILLESPIE}: struts"),
        roll_centre_rear=Ratio(0.35, 0.5, f"{GILLESPIE}: solid axle on leaf springs"),
        cornering_front=Ratio(10.0, 0.3, f"{PACEJKA}: tyres for light trucks, less for compliance"),
        cornering_rear=Ratio(12.5, 0.3, f"{PACEJKA}: tyres for light trucks, less for compliance"),
        radius=Ratio(0.34, 0.07, "tyres from 205/65 R16 C to 235/65 R16 C"),
        roll_gradient=(3.0, 9.0),
        understeer=(0.0, 5.0),
        drives={"front": Ratio(0.585, 0.1, f"3 minivans of 2004 {RATED}, with the driver alone")},
        **_COMMON,
    ),
}
"""Classes by name."""


def class_named(kind: str, drive: str | None = None) -> VehicleClass:
    """Return a class, with the front share of the axles that are driven if they are given.

    Raises:
        UnknownNameError: no such class, or no vehicle of it so driven was measured.
    """
    if kind not in CLASSES:
        raise UnknownNameError("class of vehicles", kind, CLASSES)
    named = CLASSES[kind]
    if drive is None:
        return named
    if drive not in named.drives:
        raise UnknownNameError(f"drive of a {named.title}", drive, named.drives)
    return replace(named, front_share=named.drives[drive])
