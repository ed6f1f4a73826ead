"""Animations of three failures, which replace the picture of the front page on the site.

The page itself stays plain Markdown with a picture. An animation is a page of viser's with a
recorded run, which plays without network; it is made with the site.
"""

from pathlib import Path
from typing import Any

import numpy as np
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.transforms.post_transforms import SphinxPostTransform

from fjh.live.page import LocalServer
from fjh.live.session import Session
from fjh.live.stage import Stage
from fjh.rig import Rig
from fjh.study.provenance import code_sha256
from sim import MODELS

BREAKS, ENDS, FRAME = 1500, 4500, 50
"""Ticks of 1 ms."""
NEARER, HIGHER = 0.66, 0.3
"""Distance of the camera relative to the live page's, and its added height in model extents."""
FILMS = {
    "motor": ("arm", "motor4 locks", 50, lambda session: session.make(3, "locked")),
    "sensor": (
        "hexapod",
        "its sensor is stuck",
        200,
        lambda session: session.disturb("stuck", True),
    ),
    "strut": ("hexapod", "strut1 locks", 2000, lambda session: session.make(0, "locked")),
}
"""Robot, failure, magnification of motion, and the function that causes the failure."""
LINKS = " &middot; ".join(
    f'<a href="tour/{name}.html" target="tour">{robot}: {failure}</a>'
    for name, (robot, failure, *_) in FILMS.items()
)
FRAMED = f"""
<iframe name="tour" src="tour/motor.html" title="Two robots, before and after a failure"
  style="width: 100%; height: clamp(18rem, 48vw, 27rem); border: 0"></iframe>
<p>{LINKS}. The left robot is supervised, the right one is not; failed parts are magenta.</p>
"""


class Tour(SphinxPostTransform):
    """Replace the first picture of the front page by the animations."""

    default_priority = 5
    formats = ("html",)

    def run(self, **_kwargs: Any) -> None:
        """Replace the picture if this is the front page."""
        if self.env.current_document.docname == "index":
            picture = next(iter(self.document.findall(nodes.image)))
            picture.parent.replace_self(nodes.raw("", FRAMED, format="html"))


def film(name: str, folder: Path) -> Session:
    """Write one of `FILMS`; return its session."""
    robot, failure, factor, fail = FILMS[name]
    arm = robot == "arm"
    rig = Rig.of_mjcf(MODELS / "arm.xml", major=[3, 4, 5]) if arm else Rig.hexapod()
    session, server = Session(rig), LocalServer(None)
    try:
        stage, camera = Stage(server, session), server.initial_camera
        stage.factor = factor
        camera.position = camera.look_at + NEARER * (camera.position - camera.look_at)
        camera.position += np.array([0.0, 0.0, HIGHER * rig.model.stat.extent])
        below = rig.model.stat.center - [0.0, 0.0, 0.95 * rig.model.stat.extent]
        caption = server.scene.add_label("/caption", "", position=below, anchor="top-center")
        recorded = server.get_scene_serializer()
        for tick in range(FRAME, ENDS + 1, FRAME):
            session.advance(tick - session.tick)
            stage.show()
            caption.text = (
                f"{tick / 1000:.2f} s: {failure if tick > BREAKS else 'all actuators are healthy'}"
            )
            recorded.insert_sleep(FRAME / 1000)
            if tick == BREAKS:
                fail(session)
        (folder / f"{name}.html").write_text(recorded.as_html(), encoding="utf-8")
        return session
    finally:
        server.stop()


def add(app: Sphinx, exception: Exception | None) -> None:
    """Write the animations into the site, unless they are of the present code."""
    if exception is None and app.builder.format == "html":
        folder = Path(app.outdir) / "tour"
        written, code = folder / "code.txt", code_sha256()
        if not written.exists() or written.read_text() != code:
            folder.mkdir(exist_ok=True)
            for name in FILMS:
                film(name, folder)
            written.write_text(code)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the transform and the animations."""
    app.add_post_transform(Tour)
    app.connect("build-finished", add)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
