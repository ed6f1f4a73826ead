"""Three failures, flown and filmed, in place of the picture on the front page.

That page stays plain Markdown, with a picture for who reads it elsewhere. A film is a page of
viser's own with a flight in it, which plays without network; it is made with the site.
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
"""The camera than the live page's: in parts of its distance, and in extents of the machine."""
FILMS = {
    "motor": ("arm", "motor4 locks", 50, lambda flown: flown.make(3, "locked")),
    "sensor": ("hexapod", "its sensor is stuck", 200, lambda flown: flown.disturb("stuck", True)),
    "strut": ("hexapod", "strut1 locks", 2000, lambda flown: flown.make(0, "locked")),
}
"""Robot, what happens to it, by how much motion is magnified, and how it is made to happen."""
LINKS = " &middot; ".join(
    f'<a href="tour/{name}.html" target="tour">{robot}: {happens}</a>'
    for name, (robot, happens, *_) in FILMS.items()
)
FRAMED = f"""
<iframe name="tour" src="tour/motor.html" title="Two robots, before and after a failure"
  style="width: 100%; height: clamp(18rem, 48vw, 27rem); border: 0"></iframe>
<p>{LINKS}. The left robot is supervised, the right one is not; what has failed is magenta.</p>
"""


class Tour(SphinxPostTransform):
    """Put it where the first picture of the front page is."""

    default_priority = 5
    formats = ("html",)

    def run(self, **_kwargs: Any) -> None:
        """Of one page."""
        if self.env.current_document.docname == "index":
            picture = next(iter(self.document.findall(nodes.image)))
            picture.parent.replace_self(nodes.raw("", FRAMED, format="html"))


def film(name: str, folder: Path) -> Session:
    """Write one of `FILMS`; what was flown."""
    robot, happens, factor, fail = FILMS[name]
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
                f"{tick / 1000:.2f} s: {happens if tick > BREAKS else 'all actuators are healthy'}"
            )
            recorded.insert_sleep(FRAME / 1000)
            if tick == BREAKS:
                fail(session)
        (folder / f"{name}.html").write_text(recorded.as_html(), encoding="utf-8")
        return session
    finally:
        server.stop()


def add(app: Sphinx, exception: Exception | None) -> None:
    """Write the films into the site, unless this code has done so before."""
    if exception is None and app.builder.format == "html":
        folder = Path(app.outdir) / "tour"
        known, code = folder / "code.txt", code_sha256()
        if not known.exists() or known.read_text() != code:
            folder.mkdir(exist_ok=True)
            for name in FILMS:
                film(name, folder)
            known.write_text(code)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register both."""
    app.add_post_transform(Tour)
    app.connect("build-finished", add)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
