"""Tables of an axle: what is read, and what is refused with its file and line."""

import pytest

from canroll.errors import CanrollError
from canroll.vehicles.suspensions.tables import section

STEER = "steering_wheel [deg], road_wheel [deg]\n"


@pytest.fixture
def read(tmp_path):
    def of(key, content):
        (tmp_path / "table.csv").write_text(content, encoding="utf-8")
        return section({"front": {key: "table.csv"}}, "car.toml", tmp_path).front

    return of


def test_units_marks_and_comments(read):
    english = read("spring", "# rig 3\ncompression [mm], force [kN]\n\n0, 0\n100, 2.5 # soft\n")
    german = read("spring", "compression [m]; force [N]\n0; 0\n0,1; 2500\n")
    tabs = read("spring", "force (N)\tCompression (cm)\n0\t0\n2500\t10\n")
    assert english == german == tabs
    assert english.spring.x == (0.0, 0.1) and english.spring.y == (0.0, 2500.0)


def test_the_document_of_tables_is_read_back(read):
    tables = read(
        "kinematics", "compression [mm], toe [deg], side [mm]\n-50, 0.3, -2\n50, -.3, 2\n"
    )
    assert section({"front": tables.document}, "again").front == tables
    assert tables.camber is None and tables.toe.y[0] == pytest.approx(0.3 * 3.14159265358979 / 180)


@pytest.mark.parametrize(
    ("key", "content", "message"),
    [
        ("spring", "", "empty file"),
        ("spring", "compression [mm], force [N]\n0, 0\n", "1 rows, a table has 2 to 200"),
        ("spring", "compression [mm], load [N]\n0, 0\n", "line 1: unknown column 'load'"),
        (
            "spring",
            "compression, force [N]\n0, 0\n",
            "line 1: .*compression has no unit: write .*mm",
        ),
        ("spring", "compression [in], force [N]\n0, 0\n", "line 1: .*unit 'in'"),
        ("spring", "force [N], force [N]\n0, 0\n", "line 1: column force is there twice"),
        ("spring", "force [N]\n0\n1\n", "column compression is missing"),
        ("spring", "compression [m]\n0\n1\n", "no column but compression: force"),
        ("spring", "compression [mm], force [N]\n0, 0\n1\n", "line 3: 1 numbers for 2 columns"),
        ("spring", "compression [mm], force [N]\n0, 0\n1, x\n", "line 3: 'x' is not a number"),
        (
            "spring",
            "compression [mm], force [N]\n0, 0\n0, 9\n",
            "line 3: compression must increase",
        ),
        ("spring", "compression [mm], force [N]\n0, 9\n\n9, 5\n", "line 4: a spring's force must"),
        ("spring", "compression [m], force [N]\n0, 0\n90, 5\n", "line 3: .*is it in mm"),
        ("stops", "compression [mm], force [N]\n0, 9\n9, 5\n", "line 3: a stop's force must not"),
        ("damper", "compression_speed [m/s], force [N]\n0, 0\n1, 5\n", "must cover"),
        ("damper", "compression_speed [m/s], force [N]\n-1, 9\n1, 5\n", "line 2: force 9 N drives"),
        ("damper", "compression_speed [m/s], force [N]\n-1, -1\n1, 5\n", "force 2 N at rest"),
        ("kinematics", "compression [mm], toe [rad]\n0, 0\n9, 2\n", "line 3: .*in degrees"),
        (
            "kinematics",
            "compression [mm], spring_ratio\n0, 1\n9, 0\n",
            "line 3: .*must be positive",
        ),
        ("kinematics", "compression [mm], spring_ratio\n0, 1\n9, 1\n", "needs a table spring"),
        (
            "steering",
            "steering_wheel [deg], road_wheel [deg]\n-90, -5\n0, 0\n90, 6\n180, 5.9\n",
            "line 5: road_wheel must increase with steering_wheel",
        ),
        (
            "steering",
            f"{STEER}-90, -4\n90, 5\n",
            "road_wheel 0.5° with the steering wheel straight",
        ),
        ("steering", f"{STEER}0, 0\n90, 5\n", "must cover left .* and right"),
        ("steering", f"{STEER}-90, -50\n90, 80\n", "line 3: road_wheel = 1.39626: is it in deg"),
        ("steering", "steering_wheel [rad], road_wheel [rad]\n-90, -.5\n90, .5\n", "in degrees"),
    ],
)
def test_refused_in_one_line_with_file_and_line(read, key, content, message):
    with pytest.raises(CanrollError, match=message) as caught:
        read(key, content)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("axles", "message"),
    [
        (3, "'axles' must be a table"),
        ({"middle": {}}, "unknown axle 'middle'"),
        ({"front": {"springs": {}}}, "axles.front: unknown key 'springs'"),
        ({"front": {"spring": 3}}, "axles.front.spring must be the path of a CSV file or a table"),
        ({"front": {"spring": {"compression [m]": [0, 1], "force [N]": [0]}}}, "as many numbers"),
        ({"front": {"spring": {"compression [m]": 1}}}, "must be a list"),
        ({"front": {"spring": {"compression [m]": [0, "a"]}}}, "row 2: 'a' is not a number"),
        ({"front": {"spring": {"compression [m]": [0, 0], "force [N]": [0, 1]}}}, "spring, row 2"),
        ({"front": {"bar": {"lever": 1.0}}}, "must be a table of torsional_stiffness"),
        (
            {"front": {"bar": {"torsional_stiffness": 1.0, "lever": 0.0, "ratio": 1.0}}},
            "lever and ratio must be positive",
        ),
        ({"front": {"installed": 0.1}}, "installed needs a table spring"),
        ({"rear": {"steering": {}}}, "rear.steering: only the front axle is steered: remove it"),
        ({"rear": {"steering_system": {}}}, "rear.steering_system: only the front axle"),
        ({"front": {"steering_system": {"stiffness": 1e4}}}, "torsional_stiffness, caster_trail"),
        (
            {"front": {"steering_system": {"torsional_stiffness": 0.0, "caster_trail": 0.0}}},
            "the stiffness must be positive",
        ),
        (
            {"front": {"steering_system": {"torsional_stiffness": 2e4, "caster_trail": 20}}},
            "caster_trail = 20: is it in mm",
        ),
    ],
)
def test_tables_in_the_vehicle_file_are_checked_alike(axles, message):
    with pytest.raises(CanrollError, match=message):
        section(axles, "car.toml")
