"""Import hook for a checkout, where `fjh.sim` is the module `sim` in the folder next to `fjh`.

The wheel does not contain this file; there the folders are below `fjh` (`hatch_build.py`).
"""

import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

FOLDERS = ("argument_checks", "experiments", "ftc", "kernels", "prioritized", "sim")


def alias_folders(root: Path) -> None:
    """Make `fjh.NAME` an alias of NAME, for the folders of the checkout `root`.

    Raises:
        ImportError: Python finds another module with a folder's name first.
    """
    for name in FOLDERS:
        spec = find_spec(name)
        folder = Path(spec.origin).parent if spec and spec.origin else None
        if folder != root / name:
            raise ImportError(
                f"`import {name}` finds {spec.origin or 'a folder' if spec else 'nothing'}, not "
                f"{root / name}: rename the former, or install fjh with pip install {root}",
                name="fjh",
            )
    sys.meta_path.insert(0, _FolderFinder())


class _FolderFinder(MetaPathFinder, Loader):
    """Finder and loader of `fjh.NAME...` as NAME..."""

    def __init__(self) -> None:
        self._specs: dict[str, ModuleSpec | None] = {}

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        package, _, submodule = name.partition(".")
        if package == "fjh" and submodule.partition(".")[0] in FOLDERS:
            return ModuleSpec(name, self)
        return None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        module = import_module(spec.name.removeprefix("fjh."))
        self._specs[spec.name] = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Restore the module's spec, which the import replaced; do not execute the module again."""
        name = module.__spec__.name if module.__spec__ else ""
        module.__spec__ = self._specs.pop(name)
