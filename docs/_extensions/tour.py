"""The tour of `fjh.live`, in place of the picture on the front page.

That page stays plain Markdown, with a picture for who reads it elsewhere. The tour has viser's
client in it, so that it is built with the site and not committed.
"""

import shutil
from hashlib import sha256
from pathlib import Path
from typing import Any

import viser
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.transforms.post_transforms import SphinxPostTransform

from fjh.live.tour import write_tour
from fjh.study.provenance import SOURCES, code_sha256, versions

NAME = "tour.html"
BUILT = Path(__file__).parents[2] / "build" / "tour"
FRAME = f"""
<iframe id="tour" src="{NAME}" title="When an actuator fails: a tour"
  style="width: 100%; height: 60rem; border: 0"></iframe>
<script>
addEventListener("message", event => {{
  const tour = document.getElementById("tour");
  if (event.source === tour.contentWindow) tour.style.height = `${{event.data.tourHeight}}px`;
}});
</script>
"""


class Tour(SphinxPostTransform):
    """Put it where the first picture of the front page is."""

    default_priority = 5
    formats = ("html",)

    def run(self, **_kwargs: Any) -> None:
        """Of one page."""
        if self.env.current_document.docname == "index":
            picture = next(iter(self.document.findall(nodes.image)))
            picture.parent.replace_self(nodes.raw("", FRAME, format="html"))


def add(app: Sphinx, exception: Exception | None) -> None:
    """Write it into the site; flown anew only where what it depends on has changed."""
    if exception is None and app.builder.format == "html":
        code = code_sha256((*SOURCES, "fjh/live/*.j2"))
        known_by = "".join([code, viser.__version__, *versions().values()])
        file = BUILT / f"{sha256(known_by.encode()).hexdigest()}.html"
        if not file.exists():
            write_tour(file)
        shutil.copyfile(file, Path(app.outdir) / NAME)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register both."""
    app.add_post_transform(Tour)
    app.connect("build-finished", add)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
