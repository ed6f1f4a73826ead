"""Links between the pages and the API reference, both ways; the pages stay plain Markdown.

A name in backticks on a page, as `Kinematics.passive_rates`, links to its entry in the reference.
An entry whose name stands on theory.md links back to the section.
"""

import inspect
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.transforms.post_transforms import SphinxPostTransform
from sphinx.util.nodes import make_refnode

THEORY = Path(__file__).parents[1] / "theory.md"
REFERENCE = "api/"


def name_of(code: str) -> str | None:
    """Return the name in a piece of code, without arguments; None if it may be something else.

    A lower-case word alone, as `hand`, may as well be a file, a key or an option.
    """
    match = re.fullmatch(r"([A-Za-z]\w*(?:\.[A-Za-z]\w*)*)(\(.*\))?", code, re.DOTALL)
    if not match:
        return None
    name, arguments = match.groups()
    return name if arguments or re.search(r"[._A-Z]", name) else None


def entry(name: str, documented: Iterable[str]) -> str | None:
    """Return the documented name that ends with this one, the outermost of several; None: a tie."""
    candidates = sorted((n for n in documented if f".{n}".endswith(f".{name}")), key=depth)
    tie = len(candidates) > 1 and depth(candidates[0]) == depth(candidates[1])
    return None if tie or not candidates else candidates[0]


def depth(full_name: str) -> int:
    """Return the depth of a full name in packages and classes."""
    return full_name.count(".")


def places_of(page: str) -> dict[str, dict[str, list[str]]]:
    """Return for each name on the theory page, by heading, the first cells of its table rows."""
    places: dict[str, dict[str, list[str]]] = {}
    for section in re.split(r"^## ", page, flags=re.MULTILINE)[1:]:
        heading, *lines = section.splitlines()
        for line in lines:
            label = line.split(" | ")[0].removeprefix("| ") if line.startswith("| ") else None
            for name in filter(None, map(name_of, re.findall(r"`([^`]*)`", line))):
                places.setdefault(name, {}).setdefault(heading, []).extend([label] if label else [])
    return places


def link_back(
    app: Sphinx, what: str, full_name: str, obj: object, _options: object, lines: list[str]
) -> None:
    """End a docstring with links to the sections of the theory page that name the object."""
    app.env.note_dependency(str(THEORY))
    if what == "class" and lines[:1] == (inspect.getdoc(obj.__init__) or "").splitlines()[:1]:
        return  # the class itself has them
    sections: dict[str, dict[str, None]] = {}
    for name, places in places_of(THEORY.read_text()).items():
        if full_name.endswith(f".{name}"):
            for heading, labels in places.items():
                sections.setdefault(heading, {}).update(dict.fromkeys(labels))
    for heading, labels in sections.items():
        rows = re.sub(r"\$([^$]*)\$", r":math:`\1`", "; ".join(labels))
        link = f"*Theory*, :ref:`theory:{heading}`"
        lines += ["", f"{link}: {rows}." if rows else f"{link}."]


class LinkedNames(SphinxPostTransform):
    """Make each name in backticks a link to its entry in the reference."""

    default_priority = 5

    def run(self, **_kwargs: Any) -> None:
        """Link the names of one page; pages of the reference have their own links."""
        page = self.env.current_document.docname
        if page.startswith(REFERENCE):
            return
        objects = self.env.domains.python_domain.objects
        documented = [name for name, one in objects.items() if not one.aliased]
        for literal in list(self.document.findall(nodes.literal)):
            name = name_of(literal.astext())
            if name is None or isinstance(literal.parent, nodes.reference):
                continue
            if full := entry(name.removeprefix("fjh."), documented):
                to, code = objects[full], literal.deepcopy()
                link = make_refnode(self.app.builder, page, to.docname, to.node_id, code, full)
                literal.replace_self(link)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register both directions."""
    app.connect("autodoc-process-docstring", link_back, priority=100)
    app.add_post_transform(LinkedNames)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
