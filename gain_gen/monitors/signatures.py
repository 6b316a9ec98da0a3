"""Signatures of faults: which residuals each raises, to which side, and what is wrong then."""

from gain_gen.monitors.bank import Signature

LATERAL_HAZARD = (
    "the law pushes the body by a curve that is none; it does without the lateral acceleration, or "
    "is SAFE where it needs it"
)
RATE_HAZARD = "the law damps a roll that is none: SAFE, the moment goes to zero"
AXLE_HAZARD = (
    "an axle pushes the body otherwise than commanded: no moment is asked of it any more, the "
    "other bar takes its share; an actuator that ignores commands is left to the driver, warned"
)
BOTH_HAZARD = (
    "moments push the body otherwise than commanded, it cannot be told at which axle: SAFE; "
    "actuators that ignore commands are left to the driver, warned"
)


def signatures(bits: set[str], naming: float) -> tuple[Signature, ...]:
    """Return the signatures of a bank whose residuals have these ``bits``.

    The sign of a false moment is the same in the body's balance whichever axle it is at, and
    opposite in the axles': together they name the axle. ``naming`` is how long (s) the body's waits
    for the axles'. A wrong lateral acceleration breaks the body's balance as a moment does, but
    differs from yaw rate × speed to the same side, as no moment does.
    """
    axles = "axles" in bits
    every = (
        Signature("lateral acceleration", ("body", "turn"), ("lateral",), LATERAL_HAZARD),
        Signature("lateral acceleration", ("far", "steer"), ("lateral",), LATERAL_HAZARD),
        Signature("lateral acceleration", ("opposite",), ("lateral",), LATERAL_HAZARD),
        Signature("roll rate", ("gyro front", "gyro rear"), ("rate",), RATE_HAZARD),
        Signature("roll rate", ("bias",), ("rate",), RATE_HAZARD),
        Signature("front axle", ("body", "axles"), ("front",), AXLE_HAZARD, absent=("turn",)),
        Signature(
            "rear axle", ("body",), ("rear",), AXLE_HAZARD, opposite=("axles",), absent=("turn",)
        ),
        Signature(
            "axles",
            ("body",),
            ("front", "rear"),
            BOTH_HAZARD,
            absent=("turn",),
            time=naming if axles else 0.0,
        ),
        Signature("axles", ("axles",), ("front", "rear"), BOTH_HAZARD, time=naming),
        Signature("axles", ("heave",), ("front", "rear"), BOTH_HAZARD),
    )
    return tuple(s for s in every if bits.issuperset((*s.same, *s.opposite)))
