"""Controllers of users, imported by the name that the command line gives."""

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
    """Return the factory's name, a short label for tables and files."""
    return re.sub(r"\W", "_", name.partition(":")[2])


def controller_factory(name: str) -> Callable[..., Any]:
    """Import the factory "package.module:factory" of a controller.

    The current folder is appended to the import path, for worker processes as well.

    Raises:
        WrongInput: There is no such factory, or its module cannot be imported.
    """
    module_name, _, path = name.partition(":")
    if not all(part.isidentifier() for part in (*module_name.split("."), *path.split("."))):
        raise WrongInput(f"--controller must be package.module:factory, got {name}")
    # Appended last, so that no module of the user hides one that this project imports.
    if (here := str(Path.cwd())) not in sys.path:
        sys.path.append(here)
    try:
        factory = module = importlib.import_module(module_name)
    except Exception as error:  # importing a user's module can raise anything
        message = " ".join(f"{type(error).__name__}: {error}".split())
        raise WrongInput(
            f"--controller {name}: importing {module_name} raised {message}"
        ) from error
    for part in path.split("."):
        factory = getattr(factory, part, None)
    if not callable(factory):
        place = getattr(module, "__file__", None) or module_name
        near = nearest(path, dir(module))
        raise WrongInput(f"--controller {name}: {place} has no function or class {path}{near}")
    return factory


def controller_sha256(name: str) -> str | None:
    """Return the SHA-256 of a controller's module; None if it has no file."""
    file = importlib.import_module(name.partition(":")[0]).__file__
    return None if file is None else hashlib.sha256(Path(file).read_bytes()).hexdigest()


def simulate_with(rig: Rig, name: str, path: ArrayLike, **arguments: Any) -> tuple[Run, str | None]:
    """Simulate a run with the controller of this name; return it and an error message or None.

    The controller is informed only of failures in the goal of the rig. `arguments` are those of
    :meth:`fjh.rig.Rig.fly`.
    """
    controller = GuardedController(name, controller_factory(name), rig.task)
    run = rig.fly(controller, path, **arguments)
    return run, run.state.failure
