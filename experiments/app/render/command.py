"""The command `fjh render`."""

import re
from pathlib import Path
from typing import Annotated

import typer

from experiments.output.files import published, usable_file
from experiments.output.study import Unsound
from experiments.output.terminal import raise_on_interrupt

_SIZE = re.compile(r"([1-9]\d{1,3})x([1-9]\d{1,3})")


def render(
    file: Annotated[
        Path,
        typer.Argument(metavar="FILE.rrd", help="A recording.", exists=True, dir_okay=False),
    ],
    out: Annotated[Path, typer.Option(metavar="FILE.png", help="The picture to write.")],
    time: Annotated[
        float | None,
        typer.Option(
            metavar="S", help="Simulation time to show, s.  [default: the recording's end]"
        ),
    ] = None,
    size: Annotated[
        str, typer.Option(metavar="WIDTHxHEIGHT", help="Of the picture, pixels.")
    ] = "1600x900",
) -> None:
    """Make a picture of a recording, as the viewer shows it.

    With the viewer's own headless mode: no display is needed, but a graphics card or Mesa's Vulkan
    driver (mesa-vulkan-drivers); 5 s. A viewer that complains is an error.

    Example: fjh render results/table1/W_e.rrd --time 6 --out picture.png
    """
    from experiments.app.render.viewer import ViewerError, headless_viewer, photograph, show

    pixels = _SIZE.fullmatch(size)
    if not pixels:
        raise typer.BadParameter(f"{size} is not WIDTHxHEIGHT", param_hint="--size")
    folder = usable_file(out, ".png")
    raise_on_interrupt()
    try:
        with headless_viewer((int(pixels[1]), int(pixels[2]))) as viewer:
            show(viewer, file, time)
            picture = photograph(viewer)
    except ViewerError as error:
        raise Unsound(str(error)) from None
    with published(folder, index=out.name) as staging:
        (staging / out.name).write_bytes(picture)
