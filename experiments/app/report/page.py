"""The report as one HTML page that needs no other file."""

import base64
from datetime import datetime
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

_MEDIA_TYPES = {".png": "image/png", ".svg": "image/svg+xml"}
_TEMPLATE = Environment(
    loader=PackageLoader("experiments.app.report", "."),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
).get_template("page.html.j2")


def page(summary: dict[str, Any], folder: Path) -> str:
    """The contents of `report.json` as HTML, with the figures that lie below `folder` inside."""

    def embedded(name: str, file: str) -> str:
        path = folder / name / file
        encoded = base64.b64encode(path.read_bytes()).decode("ascii")
        return f"data:{_MEDIA_TYPES[path.suffix]};base64,{encoded}"

    return _TEMPLATE.render(report=summary, folder=folder, embedded=embedded, span=span, when=when)


def when(moment: str) -> str:
    """A time of day in ISO 8601, to the minute, as people read it."""
    return f"{datetime.fromisoformat(moment):%Y-%m-%d %H:%M %Z}"


def span(seconds: float) -> str:
    """A time as people say it."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds // 60:.0f} min {seconds % 60:.0f} s"
