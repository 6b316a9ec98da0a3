"""HTML documents that need nothing from outside: styles, scripts and data are in them."""

import json
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jinja2 import Environment

PLOTS = ("uplot/uPlot.iife.min.js", "base.js", "plot.js")
"""Scripts of every page with plots, in the order in which they run."""
PLOT_STYLES = ("uplot/uPlot.min.css", "page.css")
"""Style sheets of every page with plots."""


def document(
    template: str,
    title: str,
    *,
    styles: Sequence[str],
    scripts: Sequence[str],
    data: Mapping[str, object],
    **fields: object,
) -> str:
    """Return a self-contained HTML document.

    Args:
        template: name of the Jinja2 template among the assets of this package.
        title: of the document, plain text.
        styles: names of style sheets among the assets.
        scripts: names of scripts among the assets, which run after the body is loaded.
        data: what the scripts read as JSON, by the id of the element that holds it.
        **fields: names that the template uses; texts are escaped.
    """
    return (
        _environment()
        .get_template(template)
        .render(title=title, styles=styles, scripts=scripts, data=data, **fields)
    )


@cache
def _environment() -> "Environment":
    # loaded here: the tables of a page are also printed on terminals
    from jinja2 import Environment, FunctionLoader, StrictUndefined  # noqa: PLC0415
    from markupsafe import Markup  # noqa: PLC0415

    def asset(name: str) -> Markup:
        return Markup(_asset(name))

    def embedded(value: object) -> Markup:
        return Markup(_embedded(value))

    environment = Environment(
        autoescape=True,
        loader=FunctionLoader(_asset),
        lstrip_blocks=True,
        trim_blocks=True,
        undefined=StrictUndefined,
    )
    environment.globals.update(asset=asset, embedded=embedded)
    return environment


def _asset(name: str) -> str:
    return (files("canroll.report") / "assets" / name).read_text(encoding="utf-8")


def _embedded(value: object) -> str:
    """JSON that cannot terminate its script element."""
    return json.dumps(value, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
