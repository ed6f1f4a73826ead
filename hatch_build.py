"""The wheel has one package, `fjh`: the folders of the checkout go below it.

A top-level name like `sim` would conflict with other distributions and with folders of a user.
Below `fjh`, imports use full names, line numbers are those of the checkout, and type checkers and
editors find the sources. An editable installation uses the checkout itself (`fjh/_checkout.py`).
The kernels are compiled here: a wheel is for one platform and all versions of Python. If there is
no compiler, `ziglang` is required.
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
"""String with the name of a module, or MODULE:FUNCTION, for a late import."""


def below_fjh(source: str) -> str:
    """Return the text of a module with the names of the wheel."""
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
    """Build hook that hatchling calls."""

    def dependencies(self) -> list[str]:
        """Return the requirements of the build: a compiler, if this machine has none."""
        return [] if self._kernels.compiler() else ["ziglang"]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile the kernels, and add the package to a wheel unless it is editable."""
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
        """Remove the staged package."""
        shutil.rmtree(self._staged, ignore_errors=True)

    @cached_property
    def _kernels(self) -> Any:
        """Module `kernels.build`, imported without the compiled kernels."""
        spec = spec_from_file_location("build_kernels", Path(self.root) / "kernels" / "build.py")
        assert spec is not None and spec.loader is not None
        module = module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    @property
    def _staged(self) -> Path:
        return Path(self.root) / "build" / "wheel"
