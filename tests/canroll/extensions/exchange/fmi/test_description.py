"""Descriptions of FMUs that are wrong, too large or too deep are refused in one line."""

import re
import tracemalloc
import zipfile
from pathlib import Path

import pytest

from canroll.errors import CanrollError
from canroll.extensions.exchange.fmi import description, map_file
from canroll.extensions.exchange.fmi.map_file import PlantMap

CONTENT = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="van" guid="van">
<CoSimulation modelIdentifier="van"{fixed}/><DefaultExperiment{step}/>
<ModelVariables><ScalarVariable name="x" valueReference="0"{more}><Real start="0"/></ScalarVariable>
</ModelVariables><ModelStructure/></fmiModelDescription>
"""


def fmu(folder, content, name="modelDescription.xml"):
    """Write an FMU without a library."""
    path = folder / "van.fmu"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, content)
    return path


def described(*, fixed="", step="", more=' causality="input"'):
    return CONTENT.format(fixed=fixed, step=step, more=more)


def plant_map(folder):
    return PlantMap(
        path=folder / "van.toml",
        inputs=(),
        outputs=(),
        start=(),
        ignored=frozenset(),
        step_ms=1,
    )


def refusal(folder, path):
    with pytest.raises(CanrollError) as error:
        description.read(path, plant_map(folder))
    assert "\n" not in str(error.value)
    return str(error.value)


def test_a_small_one_is_read(tmp_path):
    assert description.read(fmu(tmp_path, described()), plant_map(tmp_path)).identifier == "van"


@pytest.mark.parametrize("size", ["INF", "-INF", "NaN", "0", "-1"])
def test_a_step_that_is_none_is_refused(size, tmp_path):
    path = fmu(tmp_path, described(step=f' stepSize="{size}"'))
    assert f"{path}: " in refusal(tmp_path, path)


@pytest.mark.parametrize("name", ["modelDescription.xml", "sources/buildDescription.xml"])
def test_one_that_unpacks_to_more_than_any_has_is_refused_unread(name, tmp_path):
    path = fmu(tmp_path, b" " * (description.MOST_BYTES + 1), name)
    with zipfile.ZipFile(path, "a") as archive:
        if name != "modelDescription.xml":
            archive.writestr("modelDescription.xml", described())
    tracemalloc.start()
    assert f"{name} is larger than" in refusal(tmp_path, path)
    assert tracemalloc.get_traced_memory()[1] < 16 << 20
    tracemalloc.stop()


@pytest.mark.parametrize("depth", [300, 100_000])
def test_one_that_is_nested_too_deeply_is_refused(depth, tmp_path):
    nested = described().replace("<ModelStructure/>", "<A>" * depth + "</A>" * depth)
    assert "not a valid FMU" in refusal(tmp_path, fmu(tmp_path, nested))


def test_the_page_shows_a_map_with_every_key(tmp_path):
    page = (Path(__file__).parents[5] / "docs" / "exchange.md").read_text(encoding="utf-8")
    text = re.search(r"^```toml model.toml\n(.*?)^```", page, re.M | re.S)[1]
    path = tmp_path / "model.toml"
    path.write_text(text, encoding="utf-8")
    found = map_file.read(path)
    assert {wire.quantity for wire in found.outputs} == set(map_file.REQUIRED)
    assert found.step_ms == 1 and found.ignored == {"drive_force"}
    assert all(re.search(rf"^\[?{key}\b", text, re.M) for key in map_file.KEYS)
