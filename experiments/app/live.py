"""The command `fjh live`: a machine in the browser that one can break."""

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
            metavar="PORT",
            help="To listen at.  [default: 8080, or the next that is free]",
            bounds=(1, 65535),
        ),
    ] = None,
    seed: Annotated[int, seed_of("all noise, and of what is drawn of disturbances")] = 0,
    out: Annotated[
        Path, Option(metavar="FOLDER", help="Folder for recordings that are asked for.")
    ] = Path("results", "live"),
) -> None:
    """Break a machine in the browser, and see what its controller does about it.

    Two machines fly side by side, in real time as far as this computer keeps up: one is supervised,
    the other's controller does nothing about failures. Buttons lock, release or weaken each
    actuator, and a dot marks what it is now; others bump the payload, add hum, freeze a sensor, let
    the supply sag, or change path, weights and diagnosis. The robot is an MJCF file; without one it
    is the hexapod. The page is for browsers of this machine alone, at the address that is printed,
    until Ctrl-C; no other page that is open there can press its buttons. It is there within 8 s,
    the first time on a computer after up to two minutes.

    Writes nothing, unless asked for the last minute: live_1.rrd and so on in the folder.

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
