"""Docstrings and signatures in a form that Sphinx prints as they are written."""

import re

from docutils import nodes
from numpy.typing import ArrayLike
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.util.typing import stringify_annotation

import argument_checks
import sim

ALIASES = {
    stringify_annotation(kind, "smart"): name
    for kind, name in (
        (ArrayLike, "ArrayLike"),
        (argument_checks.Array, "Array"),
        (argument_checks.Indices, "Indices"),
        (argument_checks.Mask, "Mask"),
        (sim.Array, "Array"),
    )
}
"""Names of the array types, by the expanded names in Sphinx."""


def escape(
    _app: Sphinx, what: str, _name: str, _obj: object, _options: object, lines: list[str]
) -> None:
    """Escape bars and colons, which Sphinx reads as a substitution and as the end of a type."""
    lines[:] = [re.sub(r"(`[^`]*`)|\|", lambda m: m[1] or r"\|", line) for line in lines]
    if what in ("attribute", "data", "property") and ": " in "".join(lines[:1]):
        before, after = lines[0].split(": ", 1)
        lines[:1] = [f"{before}:", after]


def readable(
    _app: Sphinx,
    _what: str,
    _name: str,
    _obj: object,
    _options: object,
    arguments: str | None,
    returned: str | None,
) -> tuple[str | None, str | None]:
    """Name array types as the code does; omit the arguments of protocols."""
    if arguments == "(*args, **kwargs)":  # of a protocol
        return "", returned
    for long, name in {**ALIASES, "<factory>": "..."}.items():
        arguments = arguments and arguments.replace(long, name)
        returned = returned and returned.replace(long, name)
    return arguments, returned


def alias_property(_app: Sphinx, _domain: str, _kind: str, content: addnodes.desc_content) -> None:
    """Name the array type of a property as the code does."""
    for annotation in content.parent.findall(addnodes.desc_annotation):
        text = annotation.astext()
        for long, name in ALIASES.items():
            text = text.replace(re.sub(r"~(\w+\.)*", "", long), name)
        if text != annotation.astext():
            annotation.clear()
            annotation += nodes.Text(text)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the three functions above."""
    app.connect("autodoc-process-docstring", escape, priority=100)
    app.connect("autodoc-process-signature", readable)
    app.connect("object-description-transform", alias_property)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
