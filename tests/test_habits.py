"""The rules that keep the project easy to find one's way in hold, and their tools exist."""

import re
import tomllib
from pathlib import Path

import pytest

from tools.floors import LINKED, modules

ROOT = Path(__file__).parents[1]
TESTS = sorted((ROOT / "tests").rglob("test_*.py"))
HOOKS = (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")


def rooms_by_file():
    """Return which folders hold a module of each file name."""
    found = {}
    for path in modules().values():
        if path.name != "__init__.py":
            found.setdefault(path.stem, set()).add(path.resolve().parent.relative_to(ROOT))
    return found


def misplaced(tests, rooms):
    """Return the test files that don't lie where the source lies that they are named after."""
    wrong = []
    for test in tests:
        folder = test.parent
        if folder == Path("."):
            continue  # on the project as a whole
        name = test.stem.removeprefix("test_")
        here = name not in rooms or folder in rooms[name] or (ROOT / folder / name).is_dir()
        if not here or not (ROOT / folder).is_dir():
            wrong.append(test)
    return wrong


def test_the_tests_mirror_the_source():
    tests = [path.relative_to(ROOT / "tests") for path in TESTS]
    assert not misplaced(tests, rooms_by_file())


def test_a_misplaced_test_is_found():
    rooms = {"lmi": {Path("gain_gen/laws")}}
    tests = [Path("gain_gen/laws/test_lmi.py"), Path("gain_gen/test_lmi.py"), Path("no/test_x.py")]
    assert misplaced(tests, rooms) == tests[1:]


def test_support_is_all_that_tests_share_beside_fixtures():
    folders = {path.parent for path in (ROOT / "tests").rglob("*.py")}
    foreign = {f.relative_to(ROOT / "tests").parts[0] for f in folders if f != ROOT / "tests"}
    assert foreign <= {"canroll", *LINKED, "tools", "support"}


@pytest.mark.parametrize("entry", re.findall(r"^ +entry: ((?:scripts|\.venv)/.*)$", HOOKS, re.M))
def test_a_hook_runs_what_exists(entry):
    for word in entry.split():
        if "/" in word:
            assert (ROOT / word).exists(), word
    program, *arguments = entry.split()
    if program == "scripts/lint":
        assert re.search(rf"^ +{arguments[0]}\)", (ROOT / program).read_text(), re.M)


def test_no_hook_needs_an_address():
    assert re.findall(r"repo: (.*)", HOOKS) == ["local"]
    assert "scripts/lint" in (ROOT / "test.sh").read_text()


CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
DECISIONS = ROOT / "docs" / "decisions.md"
CHANGELOG = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def paths(text):
    """Return what a page names in code that is a path of the project."""
    words = {word for code in re.findall(r"`([^`\n]+)`", text) for word in code.split()}
    tops = "|".join(path.name for path in ROOT.iterdir() if path.is_dir())
    return {word.removeprefix("./") for word in words if re.match(rf"(?:\./)?(?:{tops})/", word)}


@pytest.mark.drift
@pytest.mark.parametrize("page", [ROOT / "CONTRIBUTING.md", DECISIONS], ids=lambda p: p.name)
def test_a_page_names_what_exists(page):
    missing = {path for path in paths(page.read_text("utf-8")) if not (ROOT / path).exists()}
    assert missing <= {"build/api"}


def test_modules_that_are_to_be_run_exist():
    named = re.findall(r"`python -m ([\w.]+)`", CONTRIBUTING)
    assert named and all(name in modules() for name in named)


@pytest.mark.parametrize(
    "recipe",
    re.findall(r"^### (.*?)(?=^###|\Z)", CONTRIBUTING, re.M | re.S),
    ids=lambda text: text.partition("\n")[0],
)
def test_a_recipe_has_five_steps_and_names_a_file(recipe):
    assert re.findall(r"^(\d)\.", recipe, re.M) == list("12345")
    assert paths(recipe)


def test_every_decision_has_a_number_of_its_own():
    numbers = re.findall(r"^\*\*(\d+)\. ", DECISIONS.read_text(encoding="utf-8"), re.M)
    assert sorted(map(int, numbers)) == list(range(1, len(numbers) + 1))


def test_the_newest_version_of_the_changelog_is_the_packages():
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    versions = re.findall(r"^## (\S+)(?: — (\S+))?$", CHANGELOG, re.M)
    released = [(version, date) for version, date in versions if version != "Unreleased"]
    assert released[0][0] == tomllib.loads(text)["project"]["version"]
    assert all(re.fullmatch(r"\d{4}-\d{2}-\d{2}", date) for _, date in released)
    assert [date for _, date in released] == sorted((d for _, d in released), reverse=True)
