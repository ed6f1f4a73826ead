"""The wheel has one package, `fjh`: the folders of the checkout go below it.

A name like `sim` at the top level would belong to whoever installs it last, and to any folder of a
user's. Below `fjh` imports name their package in full, lines stay where they are, and type
checkers and editors find sources where Python does. An editable installation is the checkout as it
is (`fjh/_checkout.py`). The kernels are compiled here, so a wheel is for one platform, and for all
versions of Python: `ziglang` is asked for where no compiler is.
"""

import re
import shutil
import sysconfig
from functools import cached_property
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

FOLDERS = ("argument_checks", "experiments", "ftc", "kernels", "models", "prioritized", "sim")
_NAME = rf"(?:{'|'.join(FOLDERS)})"
_IMPORT = re.compile(rf"^(\s*(?:from|import) )({_NAME}(?:\.\w+)* (?:import|as) )", re.MULTILINE)
_STRING = re.compile(rf"""(["'])({_NAME}(?:\.\w+)+(?::\w+)?\1)""")
"""A module, or MODULE:FUNCTION, that is imported when it is needed."""


def below_fjh(source: str) -> str:
    """A module's text with the names that it has in the wheel."""
    return _STRING.sub(r"\1fjh.\2", _IMPORT.sub(r"\1fjh.\2", source))


def stage(root: Path, place: Path) -> None:
    """Write the package `fjh` of the checkout `root` as folder `place`."""
    for folder in ("fjh", *FOLDERS):
        shutil.copytree(
            root / folder,
            place if folder == "fjh" else place / folder,
            ignore=shutil.ignore_patterns("__pycache__", "_checkout.py"),
            dirs_exist_ok=True,
        )
    for file in place.rglob("*.py"):
        file.write_text(below_fjh(file.read_text(encoding="utf-8")), encoding="utf-8")


class Wheel(BuildHookInterface):
    """Called by hatchling."""

    def dependencies(self) -> list[str]:
        """What the build needs beside hatchling: a compiler, if this machine has none."""
        return [] if self._kernels.compiler() else ["ziglang"]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and add the package to a wheel; an editable one has a path to the checkout."""
        try:
            self._kernels.build()
        except self._kernels.BuildError as error:
            self.app.abort(str(error))
        platform = re.sub(r"\W", "_", sysconfig.get_platform())
        build_data.update(pure_python=False, tag=f"py3-none-{platform}")
        if version != "editable":
            shutil.rmtree(self._staged, ignore_errors=True)
            stage(Path(self.root), self._staged)
            build_data["force_include"][str(self._staged)] = "fjh"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Leave nothing behind."""
        shutil.rmtree(self._staged, ignore_errors=True)

    @cached_property
    def _kernels(self) -> Any:
        """Their build, which is imported without them."""
        spec = spec_from_file_location("build_kernels", Path(self.root) / "kernels" / "build.py")
        assert spec is not None and spec.loader is not None
        module = module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    @property
    def _staged(self) -> Path:
        return Path(self.root) / "build" / "wheel"
