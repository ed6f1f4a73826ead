"""What is asked of a robot, refused by the names in its file before anything is compiled.

Of other packages MuJoCo alone is imported, which reads the file in a fraction of a second.
"""

from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.rig.hexapod.choices import STRUTS
from experiments.rig.options import RobotOptions
from experiments.study.spelling import hint
from experiments.study.study import WrongInput

if TYPE_CHECKING:  # a robot of no file needs no MuJoCo
    import mujoco


def check_robot(*, model: Path | None, **options: Any) -> None:
    """Refuse what a command's options say of a robot, if it cannot be; others are left alone.

    Raises:
        WrongInput: A number, or a name: see :class:`RobotOptions` and :func:`check_names`.
    """
    named = {each.name for each in fields(RobotOptions)} & options.keys()
    check_names(model, RobotOptions(**{name: options[name] for name in named}))


def check_names(model: Path | None, options: RobotOptions) -> None:
    """Refuse a frame, axes, keyframe or pin that a file does not have; numbers are let pass.

    What MuJoCo does not read is let pass, too: compiling it says what is wrong.

    Raises:
        WrongInput: There is none of that name; the nearest are named.
    """
    if model is None or (file := _read(model)) is None:
        return
    sites, bodies = _names(file.sites), _names(file.bodies)
    frames, kind = [*sites, *bodies], "site or body"
    asked = [("--site", options.site, kind, frames), ("--axes", options.axes, "site", sites)]
    asked.append(("--keyframe", options.keyframe, "keyframe", _names(file.keys)))
    asked += [("--pinned", name, kind, frames) for name, _ in options.pins]
    for option, name, what, known in asked:
        if name is not None and not name.isdecimal() and name not in known:
            said = f'no {what} "{name}"{hint(name, known)}' if known else "none"
            usual = "the default " if (option, name) == ("--site", RobotOptions.site) else ""
            raise WrongInput(f"{usual}{option} {name}: the model has {said}")


def actuators(model: Path | None) -> tuple[tuple[str, ...], ...]:
    """Of each actuator that a file states: its name, and that of what it drives.

    What is no MJCF has none.
    """
    if model is None:
        return STRUTS
    stated = [] if (file := _read(model)) is None else file.actuators
    return tuple((each.name or f"number {k}", each.target) for k, each in enumerate(stated))


def _read(model: Path) -> "mujoco.MjSpec | None":
    """What a file states, not compiled."""
    import mujoco

    try:
        return mujoco.MjSpec.from_file(str(model))
    except ValueError:
        return None


def _names(elements: Iterable[Any]) -> list[str]:
    return [each.name for each in elements if each.name]
