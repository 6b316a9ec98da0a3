"""The documentation site builds strictly, has all public names, and needs no other host."""

import importlib
import os
import re
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from inspect import isclass, signature
from pathlib import Path

import pytest
from support.chromium import tab

import canroll
from tools.floors import drawing, imports, modules

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
LOADS = {"src", "srcset", "data", "poster"}
"""Attributes whose addresses a browser loads; ``href`` too, but of an element ``link`` alone."""


def build(project, folder):
    """Run the build of a project."""
    return subprocess.run(
        [sys.executable, project / "scripts" / "site", folder],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The site of this checkout, which no page or docstring keeps from being built."""
    pytest.importorskip("furo")
    folder = tmp_path_factory.mktemp("site")
    done = build(ROOT, folder)
    assert (done.returncode, done.stdout, done.stderr) == (0, f"{folder}/index.html\n", "")
    return folder


@pytest.fixture(scope="module")
def described(site):
    """The names that the reference describes."""
    pages = [path.read_text("utf-8") for path in (site / "docs" / "site").glob("*.html")]
    return {name for page in pages for name in re.findall(r'<dt [^>]*\bid="([^"]+)"', page)}


def test_every_public_name_is_in_the_reference(described):
    public = {f"canroll.{name}" for name in dir(canroll)}
    door = [getattr(canroll, name) for name in dir(canroll)]
    for name, path in modules().items():
        if path.name == "__init__.py" and "\n__all__ = " in path.read_text("utf-8"):
            package = importlib.import_module(name)
            exported = {word: getattr(package, word) for word in package.__all__}
            public |= {f"{name}.{word}" for word, thing in exported.items() if thing not in door}
    assert {"canroll.run", "canroll.campaign"} < public and len(public) > 60
    assert sorted(public - described) == []


def test_what_the_door_returns_is_in_the_reference(described):
    door = [getattr(canroll, name) for name in dir(canroll)]
    returned = [signature(thing).return_annotation for thing in door if not isclass(thing)]
    ours = [kind for kind in returned if kind.__module__.split(".")[0] == "canroll"]
    assert len(ours) > 10
    for kind in ours:
        assert kind in door or f"{kind.__module__}.{kind.__qualname__}" in described


class Addresses(HTMLParser):
    """The addresses that a page loads when it is opened."""

    def __init__(self, page):
        super().__init__()
        self.loaded = []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.loaded += [
            value for name, value in attrs if name in LOADS or (tag, name) == ("link", "href")
        ]


def test_no_page_loads_anything_from_another_host(site):
    loaded = [
        address
        for page in site.rglob("*.html")
        for address in Addresses(page.read_text("utf-8")).loaded
    ]
    for sheet in site.rglob("*.css"):
        loaded += re.findall(r"(?:url\(|@import )[\"' ]*([^\"')]+)", sheet.read_text("utf-8"))
    assert len(loaded) > 100
    assert [address for address in loaded if re.match(r"\w+:(?!image/)|//", address)] == []


def test_the_drawing_of_the_architecture_is_drawn(site):
    page = (site / "docs" / "architecture.html").read_text("utf-8")
    drawn = re.search(r'<div class="flowchart"><svg .*?</svg></div>', page)[0]
    labels = re.findall(r"<text [^>]*>([^<]+)</text>", drawn)
    wanted = re.findall(r'\["(.*)"\]', drawing(imports()))
    assert sorted(labels) == sorted(wanted)


def test_the_first_page_opens_the_front_page(site):
    assert (site / "index.html").read_bytes() == (site / "README.html").read_bytes()


def test_a_search_in_the_folder_finds_pages_and_names_without_a_network(site):
    with tab("--host-resolver-rules=MAP * ~NOTFOUND") as browser:
        browser.open(f"file://{site}/index.html")
        for word, page in (
            ("certificate", "docs/certificate.html"),
            ("margins", "canroll.margins"),
        ):
            browser.open(f"file://{site}/search.html?q={word}")
            browser.wait_for("/found \\d+ page/.test(document.body.innerText)")
            found = browser.ask("[...document.querySelectorAll('#search-results a')].map(String)")
            assert any(page in address for address in found), found
        assert browser.errors == []


@pytest.fixture
def project(tmp_path):
    """A project with a page beside its front page, and the settings of this one."""
    pytest.importorskip("furo")
    for name in ("docs", "scripts", "docs/site"):
        (tmp_path / name).mkdir()
    for name in (
        "pyproject.toml",
        "scripts/site",
        "docs/site/site.css",
        *(ROOT / "docs" / "site").glob("*.py"),
    ):
        path = (ROOT / name).relative_to(ROOT)
        shutil.copy(ROOT / path, tmp_path / path)
    (tmp_path / "docs" / "site" / "canroll.rst").write_text(
        "canroll\n=======\n\n.. autofunction:: canroll.margins\n"
    )
    (tmp_path / "README.md").write_text("# a\n\n## Documentation\n\n[b](docs/b.md)\n")
    (tmp_path / "docs" / "b.md").write_text("# b\n\n[a](../README.md#documentation)\n")
    return tmp_path


def test_a_small_project_builds(project):
    done = build(project, project / "out")
    assert (done.returncode, done.stderr) == (0, "")
    assert 'href="docs/b.html"' in (project / "out" / "index.html").read_text("utf-8")


@pytest.mark.parametrize(
    ("file", "text", "told"),
    [
        ("docs/b.md", "[c](c.md)", "docs/b.md:5: WARNING: 'myst' cross-reference target not found"),
        ("docs/b.md", "[a](../README.md#gone)", "docs/b.md:5: WARNING: local id not found"),
        ("docs/b.md", "![c](c.png)", "docs/b.md:5: WARNING: image file not readable: docs/c.png"),
        ("docs/site/canroll.rst", ":func:`canroll.gone`", "target not found: canroll.gone"),
        (
            "README.md",
            "[c](docs/c.md)",
            "README.md:7: WARNING: 'myst' cross-reference target not found: 'docs/c.md'",
        ),
        ("docs/c.md", "# c", "README.md: WARNING: Documentation: no link to docs/c.md"),
    ],
)
def test_what_leads_nowhere_is_refused_with_its_place(project, file, text, told):
    with (project / file).open("a") as page:
        page.write(f"\n{text}\n")
    done = build(project, project / "out")
    assert done.returncode == 1
    assert told in done.stderr
