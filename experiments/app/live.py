"""Command `fjh live`: interactive simulation of failures in the browser."""

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

from experiments.app.terminal import progress
from fjh.rig.options import DEFAULT_OPTIONS, Model, RobotOptions
from fjh.study.files import usable_folder
from fjh.study.option import Option, seed_of


def live(
    *,
    model: Model = None,
    robot: RobotOptions = DEFAULT_OPTIONS,
    port: Annotated[
        int | None,
        Option(
            "Port to listen on.  [default: 8080, or the next free one]", "PORT", bounds=(1, 65535)
        ),
    ] = None,
    seed: Annotated[int, seed_of("all noise and random disturbances")] = 0,
    out: Annotated[
        Path, Option(metavar="FOLDER", help="Folder for recordings saved on the page.")
    ] = Path("results", "live"),
) -> None:
    """Cause failures of a robot in the browser, and watch its controller react.

    Two robots are simulated side by side, in real time if the computer is fast enough: one with the
    supervisor, one with a controller without diagnosis. Buttons lock, free or weaken each actuator,
    and a dot marks its state; other buttons bump the payload, add hum, freeze a sensor, lower the
    supply voltage, or change path, weights and diagnosis. The robot is an MJCF file, by default the
    hexapod. Only browsers on this computer can open the page, at the printed address, until Ctrl-C;
    other pages in these browsers cannot press its buttons. It is ready within 8 s, at the first
    start within two minutes.

    Writes live_1.rrd and so on to the folder when a button saves the last minute, else nothing.

    Example: fjh live arm.xml --site tool --major x,y,z
    """
    usable_folder(out)
    with ExitStack() as at_end:
        with progress("live"):
            from fjh.live.page import HOST, LocalServer, Page
            from fjh.rig.mjcf import rig_of

            rig = rig_of(model, robot)
            server = LocalServer(port)
            at_end.callback(server.stop)
            page = Page(server, rig, out, seed)
        print(f"{rig.title}: http://{HOST}:{server.get_port()} (Ctrl-C ends it)", flush=True)
        page.run()
