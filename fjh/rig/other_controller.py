"""Controllers that a user brings along: named on the command line, found where Python looks."""

import hashlib
import importlib
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from fjh.rig.rig import Rig
from fjh.rig.run import Run
from fjh.study.errors import WrongInput
from fjh.study.input_checks import nearest
from ftc import GuardedController


def controller_label(name: str) -> str:
    """A short name for tables and files: that of the factory."""
    return re.sub(r"\W", "_", name.partition(":")[2])


def controller_factory(name: str) -> Callable[..., Any]:
    """The factory of this name, "package.module:factory".

    Worker processes that are started afterwards find it, too.

    Raises:
        WrongInput: There is none.
    """
    module_name, _, path = name.partition(":")
    if not all(part.isidentifier() for part in (*module_name.split("."), *path.split("."))):
        raise WrongInput(f"--controller must be package.module:factory, got {name}")
    # Last: no module of the user's may hide one that this project imports.
    if (here := str(Path.cwd())) not in sys.path:
        sys.path.append(here)
    try:
        found = module = importlib.import_module(module_name)
    except Exception as error:  # whatever the module does when it is imported
        said = " ".join(f"{type(error).__name__}: {error}".split())
        raise WrongInput(f"--controller {name}: importing {module_name} raised {said}") from error
    for part in path.split("."):
        found = getattr(found, part, None)
    if not callable(found):
        place = getattr(module, "__file__", None) or module_name
        near = nearest(path, dir(module))
        raise WrongInput(f"--controller {name}: {place} has no function or class {path}{near}")
    return found


def controller_sha256(name: str) -> str | None:
    """SHA-256 of the module of a controller that can be imported; None if it has no file."""
    file = importlib.import_module(name.partition(":")[0]).__file__
    return None if file is None else hashlib.sha256(Path(file).read_bytes()).hexdigest()


def fly_with(rig: Rig, name: str, path: ArrayLike, **flight: Any) -> tuple[Run, str | None]:
    """A flight with the controller of this name, and what went wrong with it, in a sentence.

    Failures it is told only where the goal of the rig has them. `flight` is as of
    :meth:`fjh.rig.Rig.fly`.
    """
    pilot = GuardedController(name, controller_factory(name), rig.task)
    run = rig.fly(pilot, path, **flight)
    return run, run.state.failure
