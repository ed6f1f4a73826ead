"""Self-contained HTML pages from templates, in one style, with embedded figures."""

import base64
from pathlib import Path
from typing import Any

STYLE = "fjh.study"
"""Package of the templates `page.html.j2` and `parts.html.j2`."""


def rendered(package: str, template: str, **content: Any) -> str:
    """Return the HTML of a template of a package.

    The template may extend `page.html.j2` and import macros from `parts.html.j2` (in `fjh.study`).
    It can use the names in `content` and `data_uri`; any other name is an error.
    """
    # Late: the help text must not depend on the slow import.
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=ChoiceLoader([PackageLoader(name, ".") for name in (package, STYLE)]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(data_uri=data_uri, **content)


def data_uri(file: Path) -> str:
    """Return a picture file as a data URI, which embeds it in a page."""
    encoded = base64.b64encode(file.read_bytes()).decode("ascii")
    return f"data:image/{file.suffix[1:].replace('svg', 'svg+xml')};base64,{encoded}"


def version_text(versions: dict[str, str]) -> str:
    """Return packages and their versions as one line of text."""
    return ", ".join(f"{name} {version}" for name, version in versions.items())
