"""Measured tables of tyres: what is read, whose axes they are in, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from canroll.errors import CanrollError
from canroll.extensions.car.tyres.measured import AXES, read
from canroll.extensions.car.tyres.tyre_fit import lateral_forces
from canroll.vehicles.tyres import tir

TYRE = tir.read(Path(__file__).parents[4] / "vehicles" / "tyres" / "passenger_61.tir")
HEAD = "slip_angle_deg,load_n,camber_deg,lateral_force_n"
ROWS = ["-4,3000,0,2000", "-1,3000,0,600", "1,3000,0,-600", "4,3000,0,-2000"]


@pytest.fixture
def table(tmp_path):
    def of(*lines, axes="iso"):
        path = tmp_path / "t.csv"
        path.write_text("\n".join(lines) + "\n")
        return read(path, axes)

    return of


def rows_of(cambers=(-4.0, 0.0, 4.0)):
    """Rows of a tyre in axes of ISO 8855: slip angle (°), load (N), camber (°), force (N)."""
    grid = np.meshgrid(np.linspace(-12, 12, 13), [2000.0, 4000.0], cambers, indexing="ij")
    slip, load, camber = (axis.ravel() for axis in grid)
    force = lateral_forces(TYRE, np.radians(slip), load, np.radians(camber))
    return np.column_stack([slip, load, camber, force])


def written(rows, axes):
    """Rows as another axes' system has them (ISO 8855, annex; Pacejka, appendix 1)."""
    slip, load, camber, force = rows.T
    to_the_right = {"iso": (slip, load, force), "sae": (-slip, -load, -force)}
    slip, load, force = to_the_right.get(axes, (slip, load, -force))
    return [
        HEAD,
        *(",".join(map(repr, map(float, r))) for r in zip(slip, load, camber, force, strict=True)),
    ]


def test_units_names_comments_and_separators_do_not_matter(table):
    plain = table(HEAD, *ROWS)
    assert plain.slip_angle[0] == pytest.approx(np.radians(-4)) and plain.load[0] == 3000.0
    other = table(
        "# measured today",
        "FY_kN;Alpha;time;fz_kn",
        "% and more",
        *(f"{f / 1e3};{a};0;3" for a, f in zip(plain.slip_angle, plain.force, strict=True)),
        "",
    )
    assert other.slip_angle == pytest.approx(plain.slip_angle)
    assert other.force == pytest.approx(plain.force) and other.load == pytest.approx(plain.load)
    assert not other.camber.any()


def test_rows_without_a_number_are_left_out_and_counted(table):
    measured = table(HEAD, *ROWS, "2,3000,,-1200", "2,nan,0,-1200")
    assert len(measured) == 4 and measured.remarks == ("t.csv: 2 rows without a number: left out",)


@pytest.mark.parametrize("axes", AXES)
def test_a_table_in_other_axes_is_the_same_tyre(table, axes):
    rows = rows_of()
    measured = table(*written(rows, axes), axes=axes)
    assert np.degrees(measured.slip_angle) == pytest.approx(rows[:, 0])
    assert measured.load == pytest.approx(rows[:, 1])
    assert measured.force == pytest.approx(rows[:, 3])


@pytest.mark.parametrize("axes", AXES)
@pytest.mark.parametrize("said", AXES)
def test_a_table_that_is_not_in_its_axes_is_refused_with_the_remedy(table, axes, said):
    if axes == said:
        return
    lines = written(rows_of(), axes)
    with pytest.raises(CanrollError, match=f"give --axes {axes}$") as caught:
        table(*lines, axes=said)
    assert "\n" not in str(caught.value)


def test_signs_of_no_axes_are_named(table):
    rows = rows_of()
    rows[:, 0] *= -1.0
    with pytest.raises(CanrollError, match=r"rises with the slip angle and falls .* reverse"):
        table(*written(rows, "iso"))
    # without camber it may be in adapted axes
    rows = rows_of([0.0])
    rows[:, 3] *= -1.0
    with pytest.raises(CanrollError, match=r"rises with the slip angle, .* --axes adapted-sae"):
        table(*written(rows, "iso"))


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ((HEAD.replace("load_n", "weight"), *ROWS), "no column of the load: name it load_n or"),
        ((HEAD.replace("camber", "alpha"), *ROWS), "slip_angle_deg and alpha_deg are both the"),
        ((HEAD.replace("angle_deg", "angle"), *ROWS), r"slip_angle: up to 4 rad: if it is in deg"),
        ((HEAD, *ROWS, "4,3,x,-2"), "t.csv: line 6: camber_deg: 'x' is no number"),
        ((HEAD, *ROWS, "4,-3000,0,-2000"), "load_n: -3000 N: a load must be positive"),
        ((HEAD, *(row.replace("3000", "3") for row in ROWS)), "up to 3 N: if it is in kN"),
        ((HEAD, *(row[:-5] + ",0" for row in ROWS[:1])), "all forces are 0"),
        ((HEAD, "a comment"), "no row with numbers|is no number"),
        (("# nothing",), "no table"),
    ],
)
def test_what_is_no_table_is_refused_in_one_line(table, lines, message):
    with pytest.raises(CanrollError, match=message) as caught:
        table(*lines)
    assert "\n" not in str(caught.value)
