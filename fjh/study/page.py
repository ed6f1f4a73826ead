"""A self-contained HTML page from a template: one style, figures inside, everything escaped."""

import base64
from pathlib import Path
from typing import Any

STYLE = "fjh.study"
"""Where `page.html.j2` and `parts.html.j2` lie."""


def rendered(package: str, template: str, **content: Any) -> str:
    """The HTML of a template that lies in a package.

    It may extend `page.html.j2` and take macros from `parts.html.j2`, which lie beside this file,
    and knows `data_uri` besides its content; any other name is an error.
    """
    # Late: the help text does not wait for the import.
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=ChoiceLoader([PackageLoader(each, ".") for each in (package, STYLE)]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(data_uri=data_uri, **content)


def data_uri(file: Path) -> str:
    """A picture as an address that holds it: the page needs no other file."""
    encoded = base64.b64encode(file.read_bytes()).decode("ascii")
    return f"data:image/{file.suffix[1:].replace('svg', 'svg+xml')};base64,{encoded}"


def named_versions(versions: dict[str, str]) -> str:
    """Packages and their versions for people."""
    return ", ".join(f"{name} {version}" for name, version in versions.items())
