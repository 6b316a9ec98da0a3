"""The Magic Formula tyre of Pacejka, versions 5.2, 6.1 and 6.2, from the coefficients of its file.

The kernel reads numbers into which scaling factors and inflation pressure are multiplied, as both
are constant in a run; :mod:`canroll.vehicles.tyres.tir` reads the file. Forces and moment are those
of a tyre on a straight or slowly turning path: turn slip is left out, as are overturning moment and
rolling resistance (the vehicle file has one).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import atan, exp, pi, sin, tan
from typing import Any, ClassVar

from canroll.vehicles.tyres import MOST_SLIP, TyreModel

OLD = (6.0, 21.0, 52.0)
"""FITTYP of version 5.2."""
NEW = (61.0, 62.0)
"""FITTYP of versions 6.1 and 6.2, whose forces in steady state are the same."""

NEEDED = (
    *("FITTYP", "UNLOADED_RADIUS", "FNOMIN"),
    *("PCX1", "PDX1", "PKX1", "PCY1", "PDY1", "PKY1", "PKY2"),
)
"""Keys without which there is no tyre."""
SCALES = (
    *("LFZO", "LCX", "LMUX", "LEX", "LKX", "LHX", "LVX", "LXAL"),
    *("LCY", "LMUY", "LEY", "LKY", "LHY", "LVY", "LYKA", "LVYKA"),
    *("LKYC", "LKZC", "LTR", "LRES", "LS", "LSGAL"),
)
"""Scaling factors, 1 where the file has none."""
LIMITS = (
    *("PRESMIN", "PRESMAX", "FZMIN", "FZMAX", "KPUMIN", "KPUMAX"),
    *("ALPMIN", "ALPMAX", "CAMMIN", "CAMMAX"),
)
"""Limits of validity."""
WHEEL = ("VERTICAL_STIFFNESS", "VERTICAL_DAMPING", "LATERAL_STIFFNESS", "INFLPRES", "NOMPRES")
"""Other keys that are not coefficients."""


def _numbered(*families: str) -> Iterator[str]:
    """Names of coefficients: "PCX1-2" are PCX1 and PCX2."""
    for family in families:
        name, _, last = family.rpartition("-")
        for number in range(int(name[-1]), int(last) + 1):
            yield name[:-1] + str(number)


COEFFICIENTS = (
    *_numbered("PCX1-1", "PDX1-3", "PEX1-4", "PKX1-3", "PHX1-2", "PVX1-2", "PPX1-4"),
    *_numbered("RBX1-3", "RCX1-1", "REX1-2", "RHX1-1"),
    *_numbered("PCY1-1", "PDY1-3", "PEY1-5", "PKY1-7", "PHY1-3", "PVY1-4", "PPY1-5"),
    *_numbered("RBY1-4", "RCY1-1", "REY1-2", "RHY1-2", "RVY1-6"),
    *_numbered("QBZ1-5", "QBZ9-10", "QCZ1-1", "QDZ1-4", "QDZ6-11", "QEZ1-5", "QHZ1-4"),
    *_numbered("PPZ1-2", "SSZ1-4", "PTY1-2", "PCFY1-3"),
)
"""Coefficients that are read; 0 where the file has none, but PKY4, which is 2."""
KEYS = (*NEEDED, *COEFFICIENTS, *SCALES, *LIMITS, *WHEEL, "TYRESIDE")
"""All that is read of a file; TYRESIDE is 1 for left and -1 for right."""
POSITIVE = (
    *("UNLOADED_RADIUS", "FNOMIN", "PCX1", "PKX1", "PCY1", "PKY2"),
    *("LFZO", "LMUX", "LMUY", "LKX", "LKY", "LCX", "LCY"),
)
"""Keys whose numbers are positive."""
UNLIMITED = {"KPU": 1e3, "ALP": 1.57, "CAM": 1.0, "FZ": 1e9}
"""Limits where the file has none."""


@dataclass(frozen=True, slots=True)
class Coefficients:
    """What a file of a tyre says, by its keys."""

    values: Mapping[str, float]

    def __getitem__(self, key: str) -> float:
        """The number of a key, or what its version takes where the file has none."""
        if key in self.values:
            return self.values[key]
        if key in SCALES or key == "TYRESIDE":
            return 1.0
        if key[:-3] in UNLIMITED:
            return -UNLIMITED[key[:-3]] if key.endswith("MIN") else UNLIMITED[key[:-3]]
        return 2.0 if key == "PKY4" else 0.0

    @property
    def is_old(self) -> bool:
        """Whether it is of version 5.2."""
        return self["FITTYP"] in OLD

    @property
    def nominal_load(self) -> float:
        """Scaled nominal load (N)."""
        return self["FNOMIN"] * self["LFZO"]

    @property
    def pressure(self) -> float:
        """Inflation pressure over the nominal one, less 1; 0 where the file does not have both."""
        if "INFLPRES" not in self.values or not self["NOMPRES"] or self.is_old:
            return 0.0
        return self["INFLPRES"] / self["NOMPRES"] - 1.0

    def quadratic(self, family: str, first: int, scale: float = 1.0) -> float:
        """1 + c p + d p² of the relative pressure, with two coefficients of a family."""
        p = self.pressure
        return scale * (1.0 + self[f"{family}{first}"] * p + self[f"{family}{first + 1}"] * p * p)

    def cornering(self, load: float) -> float:
        """Cornering stiffness (N/rad, < 0) without camber (4.E25)."""
        p, nominal = self.pressure, self.nominal_load
        softened = self["PKY2"] * (1.0 + self["PPY2"] * p) * nominal
        rise = sin(self["PKY4"] * atan(load / softened))
        return self["PKY1"] * nominal * (1.0 + self["PPY1"] * p) * rise * self["LKY"]

    def longitudinal(self, load: float) -> float:
        """Slip stiffness (N) (4.E15)."""
        overload = load / self.nominal_load - 1.0
        rise = (self["PKX1"] + self["PKX2"] * overload) * exp(self["PKX3"] * overload)
        return load * rise * self.quadratic("PPX", 1, self["LKX"])

    def friction(self, load: float) -> float:
        """Lateral peak over load, without camber (4.E23)."""
        overload = load / self.nominal_load - 1.0
        return (self["PDY1"] + self["PDY2"] * overload) * self.quadratic("PPY", 3, self["LMUY"])

    def grip(self, load: float) -> float:
        """Lateral peak (N), without camber."""
        return abs(self.friction(load)) * load

    def curvature(self, load: float) -> float:
        """Mean curvature of the lateral force for both signs of the slip (4.E24)."""
        overload = load / self.nominal_load - 1.0
        return (self["PEY1"] + self["PEY2"] * overload) * self["LEY"]

    def relaxation(self, load: float) -> float | None:
        """Lateral relaxation length (m); None where the file has no coefficients of it."""
        if self.is_old:
            if not self["PTY1"] or not self["PTY2"]:
                return None
            rise = sin(2.0 * atan(load / (self["PTY2"] * self.nominal_load)))
            length = self["PTY1"] * rise * self["UNLOADED_RADIUS"]
            return abs(length * self["LFZO"] * self["LSGAL"])
        if not self["LATERAL_STIFFNESS"]:
            return None
        overload = load / self.nominal_load - 1.0
        bending = 1.0 + overload * (self["PCFY1"] + self["PCFY2"] * overload)
        stiffness = self["LATERAL_STIFFNESS"] * bending * (1.0 + self["PCFY3"] * self.pressure)
        return abs(self.cornering(load) / stiffness)


def _longitudinal(of: Coefficients) -> Iterator[tuple[str, float]]:
    grip, stiffness = of.quadratic("PPX", 3, of["LMUX"]), of.quadratic("PPX", 1, of["LKX"])
    yield "cx", of["PCX1"] * of["LCX"]
    yield from (("dx1", of["PDX1"] * grip), ("dx2", of["PDX2"] * grip), ("dx3", of["PDX3"]))
    yield from ((f"ex{i}", of[f"PEX{i}"] * of["LEX"]) for i in (1, 2, 3))
    yield "ex4", of["PEX4"]
    yield from (("kx1", of["PKX1"] * stiffness), ("kx2", of["PKX2"] * stiffness))
    yield "kx3", of["PKX3"]
    yield from ((f"hx{i}", of[f"PHX{i}"] * of["LHX"]) for i in (1, 2))
    yield from ((f"vx{i}", of[f"PVX{i}"] * of["LVX"] * of["LMUX"]) for i in (1, 2))
    yield from (("bxa1", of["RBX1"] * of["LXAL"]), ("bxa3", of["RBX3"] * of["LXAL"]))
    yield from (("bxa2", of["RBX2"]), ("cxa", of["RCX1"]), ("hxa", of["RHX1"]))
    yield from (("exa1", of["REX1"]), ("exa2", of["REX2"]))


def _lateral(of: Coefficients) -> Iterator[tuple[str, float]]:
    p, nominal, old = of.pressure, of.nominal_load, of.is_old
    grip, camber = of.quadratic("PPY", 3, of["LMUY"]), of["LKYC"]
    yield "cy", of["PCY1"] * of["LCY"]
    yield from (("dy1", of["PDY1"] * grip), ("dy2", of["PDY2"] * grip), ("dy3", of["PDY3"]))
    yield from ((f"ey{i}", of[f"PEY{i}"] * of["LEY"]) for i in (1, 2))
    yield from ((f"ey{i}", of[f"PEY{i}"]) for i in (3, 4))
    yield "ey5", 0.0 if old else of["PEY5"]
    yield "ky1", of["PKY1"] * nominal * (1.0 + of["PPY1"] * p) * of["LKY"]
    yield "ky2", of["PKY2"] * nominal * (1.0 + of["PPY2"] * p)
    yield "ky5", 0.0 if old else of["PKY5"] * nominal * (1.0 + of["PPY2"] * p)
    yield from (("ky3", of["PKY3"]), ("ky4", 2.0 if old else of["PKY4"]))
    yield from ((f"kg{i}", of[f"PKY{5 + i}"] * (1.0 + of["PPY5"] * p) * camber) for i in (1, 2))
    yield from ((f"hy{i}", of[f"PHY{i}"] * of["LHY"]) for i in (1, 2))
    yield "hy3", of["PHY3"] * camber if old else 0.0
    yield from ((f"vy{i}", of[f"PVY{i}"] * of["LVY"] * of["LMUY"]) for i in (1, 2))
    yield from ((f"vy{i}", of[f"PVY{i}"] * camber * of["LMUY"]) for i in (3, 4))
    yield from (("byk1", of["RBY1"] * of["LYKA"]), ("byk4", of["RBY4"] * of["LYKA"]))
    yield from (("byk2", of["RBY2"]), ("byk3", of["RBY3"]), ("cyk", of["RCY1"]))
    yield from (("eyk1", of["REY1"]), ("eyk2", of["REY2"]))
    yield from (("hyk1", of["RHY1"]), ("hyk2", of["RHY2"]))
    yield from ((f"vyk{i}", of[f"RVY{i}"] * of["LVYKA"]) for i in (1, 2, 3))
    yield from ((f"vyk{i}", of[f"RVY{i}"]) for i in (4, 5, 6))


def _aligning(of: Coefficients) -> Iterator[tuple[str, float]]:
    p, radius, grip = of.pressure, of["UNLOADED_RADIUS"], of["LMUY"]
    softer = of["LKY"] / grip
    yield from ((f"bt{i}", of[f"QBZ{i}"] * softer) for i in (1, 2, 3))
    yield from (("bt4", of["QBZ4"]), ("bt5", of["QBZ5"]), ("ct", of["QCZ1"]))
    length = (1.0 - of["PPZ1"] * p) * radius / of["FNOMIN"] * of["LTR"]
    yield from (("dt1", of["QDZ1"] * length), ("dt2", of["QDZ2"] * length))
    yield from (("dt3", of["QDZ3"]), ("dt4", of["QDZ4"]))
    yield from ((f"et{i}", of[f"QEZ{i}"]) for i in (1, 2, 3))
    yield from ((f"et{i}", of[f"QEZ{i}"] * 2.0 / pi) for i in (4, 5))
    yield from ((f"ht{i}", of[f"QHZ{i}"]) for i in (1, 2, 3, 4))
    yield from (("br9", of["QBZ9"] * softer), ("br10", of["QBZ10"]))
    yield from ((f"dr{i}", of[f"QDZ{i}"] * of["LRES"] * grip * radius) for i in (6, 7))
    camber = of["LKZC"] * grip * radius
    yield from ((f"dr{i}", of[f"QDZ{i}"] * (1.0 + of["PPZ2"] * p) * camber) for i in (8, 9))
    yield from ((f"dr{i}", of[f"QDZ{i}"] * camber) for i in (10, 11))
    yield from ((f"s{i}", of[f"SSZ{i}"] * radius * of["LS"]) for i in (1, 3, 4))
    yield "s2", of["SSZ2"] * radius * of["LS"] / of["FNOMIN"]


def _conditions(of: Coefficients) -> Iterator[tuple[str, float]]:
    yield from (("per_nominal", 1.0 / of.nominal_load), ("six", 0.0 if of.is_old else 1.0))
    yield from (("side", of["TYRESIDE"]), ("load_max", of["FZMAX"]))
    yield from (("ratio_min", of["KPUMIN"]), ("ratio_max", of["KPUMAX"]))
    yield from (("slip_min", tan(of["ALPMIN"])), ("slip_max", tan(of["ALPMAX"])))
    yield from (("camber_min", sin(of["CAMMIN"])), ("camber_max", sin(of["CAMMAX"])))


def _kernel_numbers(of: Coefficients) -> dict[str, float]:
    """What the kernel reads, by name: scaling factors and pressure are multiplied in."""
    return dict([*_conditions(of), *_longitudinal(of), *_lateral(of), *_aligning(of)])


_ANY = Coefficients(dict.fromkeys(NEEDED, 1.0))


@dataclass(frozen=True, slots=True)
class MagicFormula(TyreModel):
    """One tyre by its file's coefficients; what designs take of it is the mean of left and right.

    Attributes:
        coefficients: of its file.
        parameters: of the kernel, in the order of :data:`NUMBERS`.
    """

    NUMBERS: ClassVar = tuple(_kernel_numbers(_ANY))
    coefficients: Coefficients
    parameters: tuple[float, ...]

    @classmethod
    def of(cls, coefficients: Coefficients) -> "MagicFormula":
        """The tyre of a file."""
        return cls(coefficients, tuple(_kernel_numbers(coefficients).values()))

    @classmethod
    def of_axle(cls, vehicle: Any, axle: int, wheel_load: float) -> "MagicFormula":  # noqa: ANN401
        """The tyre of an axle, from the vehicle's ``magic_formula`` section."""
        both = vehicle.magic_formula
        assert both is not None
        return cls.of(Coefficients((both.front, both.rear)[axle]))

    def relaxation(self, load: float) -> float | None:
        """Lateral relaxation length (m) of the file; None where it has none."""
        return self.coefficients.relaxation(load)

    def lateral(self, load: float, slip_angle: float, friction: float) -> tuple[float, float]:
        """Lateral force (N) of a freely rolling tyre, and its slope over the slip angle (N/rad).

        The mean of a left and a right tyre: what makes a straight-running tyre pull cancels.
        """
        ahead = TyreModel.lateral(self, load, slip_angle, friction)
        behind = TyreModel.lateral(self, load, -slip_angle, friction)
        return 0.5 * (ahead[0] - behind[0]), 0.5 * (ahead[1] + behind[1])

    def grip(self, load: float, friction: float) -> float:
        """Largest lateral force (N) of a freely rolling tyre, mean of a left and a right one."""
        # commands that only name vehicles load no scipy
        from scipy.optimize import minimize_scalar  # noqa: PLC0415

        best = minimize_scalar(
            lambda slip: -self.lateral(load, slip, friction)[0],
            bounds=(0.0, MOST_SLIP),
            method="bounded",
        )
        return float(-best.fun)
