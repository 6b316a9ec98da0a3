"""What canroll asks of every extension."""

from canroll.testing import (
    BodyConformance,
    BusConformance,
    LawConformance,
    ManoeuvreConformance,
)


class TestSkyhook(LawConformance):
    law = "skyhook"


class TestHeavyRoof(BodyConformance):
    body = "heavy_roof"


class TestWeave(ManoeuvreConformance):
    scenario = "weave"


class TestVan(BusConformance):
    bus = "250k_van"
