"""The command `fjh`, and the check that no folder of a user hides this project's packages.

A module with a name of its own, since `experiments` may be hidden too; on the standard library
alone, so that Ctrl-C is handled early.
"""

import sys
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).resolve().parent
"""Of this project's packages, which are neighbours in a checkout and in site-packages alike."""


def check_not_hidden(importer: str, *packages: str) -> None:
    """Refuse to go on if Python would import another package or module of the same name.

    Args:
        importer: Whoever needs the packages; the `name` of the error.
        packages: Top-level packages of this project.

    Raises:
        ImportError: Python finds something else first; the message names both folders.
    """
    for package in packages:
        expected = (ROOT / package).resolve()
        if (found := _found(package)) != expected:
            raise ImportError(
                f"`import {package}` finds {found or 'nothing'}, which hides {expected}: rename "
                "it, or run from a folder that does not contain it",
                name=importer,
            )


def _found(package: str) -> Path | None:
    """Folder or file that Python would import."""
    if (spec := find_spec(package)) is None:
        return None
    folders = list(spec.submodule_search_locations or ())
    return Path(folders[0] if folders else spec.origin or package).resolve()


def run() -> None:
    """Entry point of the console script; a hidden package is one sentence, exit code 2."""
    try:
        check_not_hidden("fjh", "experiments")
        import experiments  # noqa: F401  (which checks the packages below it)
    except ImportError as error:
        print(f"fjh: {error}", file=sys.stderr)
        sys.exit(2)
    from experiments.__main__ import run

    run()
