"""Draw Mermaid's flowcharts, which the repository's viewer draws by a script from its own host."""

import re
from html import escape

from docutils import nodes
from sphinx.util.docutils import SphinxDirective

STEP, LETTER, HEIGHT, GAP = 74, 7.6, 30, 18
"""From row to row; of a letter; of a box; between boxes (px)."""


class Flowchart(SphinxDirective):
    """A fence ``mermaid`` with lines ``a["label"]`` and ``a --> b``, arrows without circles."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """Return the drawing, in place of the fence."""
        return [nodes.raw("", drawing("\n".join(self.content)), format="html")]


def drawing(text: str) -> str:
    """Return a flowchart as SVG: each box a row above all that its arrows lead to."""
    labels = dict(re.findall(r'(\w+)\["(.*)"\]', text))
    arrows = re.findall(r"(\w+) --> (\w+)", text)
    rows = ordered(labels, arrows)
    width = {name: 2 * GAP + LETTER * len(label) for name, label in labels.items()}
    full = max(sum(width[name] + GAP for name in row) for row in rows)
    middle, top, boxes = {}, {}, []
    for number, row in enumerate(rows):
        left = (full - sum(width[name] + GAP for name in row)) / 2
        for name in row:
            middle[name], top[name] = left + (width[name] + GAP) / 2, number * STEP + 1
            left += width[name] + GAP
            boxes.append(
                f'<rect x="{middle[name] - width[name] / 2:.0f}" y="{top[name]}" rx="4" '
                f'width="{width[name]:.0f}" height="{HEIGHT}"/><text x="{middle[name]:.0f}" '
                f'y="{top[name] + HEIGHT / 2 + 5}">{escape(labels[name])}</text>'
            )
    lines = []
    for one, other in arrows:
        start, end = top[one] + HEIGHT, top[other] - 6
        lines.append(
            f'<path d="M{middle[one]:.0f} {start} C{middle[one]:.0f} {start + STEP / 2} '
            f'{middle[other]:.0f} {end - STEP / 2} {middle[other]:.0f} {end}"/>'
        )
    return (
        '<div class="flowchart">'
        f'<svg viewBox="0 0 {full:.0f} {len(rows) * STEP - STEP + HEIGHT + 2}">'
        '<defs><marker id="tip" viewBox="0 0 6 6" refX="1" refY="3" markerWidth="6" '
        'markerHeight="6" orient="auto"><path d="M0 0 L6 3 L0 6z"/></marker></defs>'
        f"{''.join([*lines, *boxes])}</svg></div>"
    )


def ordered(labels: dict[str, str], arrows: list[tuple[str, str]]) -> list[list[str]]:
    """Return the boxes by row, those of a row in the order of what leads to them."""
    row = dict.fromkeys(labels, 0)
    for _ in labels:
        for one, other in arrows:
            row[other] = max(row[other], row[one] + 1)
    for one in labels:  # no higher than needed
        row[one] = min((row[b] - 1 for a, b in arrows if a == one), default=row[one])
    rows = [[name for name in labels if row[name] == k] for k in range(max(row.values()) + 1)]
    place = {name: (k + 1) / (len(line) + 1) for line in rows for k, name in enumerate(line)}
    for _ in range(8):
        for line in rows:
            for name in line:
                near = [place[a] for a, b in arrows if b == name]
                near += [place[b] for a, b in arrows if a == name]
                place[name] = sum(near) / len(near) if near else place[name]
            line.sort(key=place.__getitem__)
            place |= {name: (k + 1) / (len(line) + 1) for k, name in enumerate(line)}
    return rows
