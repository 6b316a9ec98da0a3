"""Sphinx's settings of the documentation site, which ``scripts/site`` builds.

The pages are those that the repository shows. README.md is the front page, and what its section
"Documentation" links is the navigation, in that order, with its lines that end in a colon as
captions. ``*.rst`` here are the API reference.
"""

import re
import sys
import tomllib
from pathlib import Path

from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx
from sphinx.util.logging import getLogger

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "docs" / "site")]

from flowchart import Flowchart  # noqa: E402 - beside this file

LOG = getLogger(__name__)
project = "canroll"
release = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["version"]
html_title = f"canroll {release}"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "reference"]
root_doc = "README"
PAGES = ["CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md", "docs/*.md", "examples/*/README.md"]
REFERENCE = "docs/site/*"
include_patterns = ["README.md", *PAGES, f"{REFERENCE}.rst"]
exclude_patterns = [".*", "build"]
nitpicky = True
suppress_warnings = ["toc.not_included"]  # what follows says so in its own words
smartquotes_action = "D"  # dashes of the reference; quotes stay as they are written
myst_heading_anchors = 4
myst_fence_as_directive = ["mermaid"]
autodoc_default_options = {"members": True}
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_typehints_format = "short"
python_maximum_signature_line_length = 80
napoleon_custom_sections = [("Attributes", "params_style")]
toc_object_entries_show_parents = "hide"
html_theme = "furo"
html_static_path = ["site.css"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_copyright = False
html_show_search_summary = False  # it fetches pages, which browsers refuse in a folder


def navigation(front: str) -> str:
    """Return tables of contents: what the front page links under "Documentation", in its order.

    A page that it leaves out is a warning, which fails the build.
    """
    section = front.partition("\n## Documentation\n")[2].partition("\n## ")[0]
    _, *parts = re.split(r"^(.+):$", f"Documentation:\n{section}", flags=re.MULTILINE)
    linked = [re.findall(r"\]\(([^)#:]+\.md)\)", text) for text in parts[1::2]]
    pages = {str(path.relative_to(ROOT)) for glob in PAGES for path in ROOT.glob(glob)}
    for page in sorted(pages.difference(*linked)):
        LOG.warning("Documentation: no link to %s", page, location=root_doc)
    tables = [
        contents(caption, *(f"{short_title(page)} </{page}>" for page in listed if page in pages))
        for caption, listed in zip(parts[::2], linked, strict=True)
        if listed
    ]
    return "".join([*tables, contents("API reference", ":glob:", "", f"/{REFERENCE}")])


def contents(caption: str, *lines: str) -> str:
    """Return a table of contents that the navigation shows, and not the page."""
    return "\n".join(["", "```{toctree}", ":hidden:", f":caption: {caption}", *lines, "```", ""])


def short_title(page: str) -> str:
    """Return a page's title up to its colon."""
    return (ROOT / page).read_text("utf-8").partition("\n")[0].removeprefix("# ").split(":")[0]


def add_navigation(_app: Sphinx, page: str, source: list[str]) -> None:
    """Give the front page the tables of contents."""
    if page == root_doc:
        source[0] += navigation(source[0])


def setup(app: Sphinx) -> None:
    """Connect the navigation, and name fences that Pygments doesn't know."""
    app.connect("source-read", add_navigation)
    app.add_directive("mermaid", Flowchart)
    app.add_lexer("csv", TextLexer)
