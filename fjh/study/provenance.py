"""Where results come from: machine, commit, versions, and the code itself."""

import hashlib
import os
import platform
import subprocess
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import psutil

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
_SOURCES = (
    "argument_checks/**/*.py",
    "experiments/**/*.py",
    "fjh/**/*.py",
    "ftc/**/*.py",
    "kernels/*.[ch]",
    "kernels/*.py",
    "models/*.xml",
    "prioritized/**/*.py",
    "sim/**/*.py",
)
_REPORT = ("experiments/app/*.py",)
"""All that makes numbers, figures and captions; and the report itself, which only shows them."""

PACKAGES = ("mujoco", "numpy", "scipy", "control", "rerun-sdk", "matplotlib")


def machine() -> dict[str, Any]:
    """Processor, cores, memory and system that the wall times belong to."""
    return {
        "processor": processor(),
        "cores": psutil.cpu_count(logical=False) or os.cpu_count(),
        "threads": os.cpu_count(),
        "memory_gib": round(psutil.virtual_memory().total / 2**30, 1),
        "system": platform.platform(),
    }


def processor() -> str:
    """The processor's name, as far as the system gives it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return next(iter(names), platform.processor() or platform.machine())


def commit() -> str:
    """The commit of the checkout that this file belongs to, and whether more has changed since."""
    # Installed below somebody else's checkout this file is not one of theirs.
    if _git("ls-files", "--error-unmatch", __file__) is None:
        return "not a git checkout"
    changes = ", with uncommitted changes" if _git("status", "--porcelain") else ""
    return f"{_git('rev-parse', 'HEAD')}{changes}"


def code_sha256() -> str:
    """SHA-256 over the names and contents of the files that make numbers."""
    digest = hashlib.sha256()
    for file in sorted(_matching(_SOURCES) - _matching(_REPORT)):
        digest.update(f"{file.relative_to(ROOT).as_posix()}\0".encode())
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def _matching(patterns: Iterable[str]) -> set[Path]:
    return {file for pattern in patterns for file in ROOT.glob(pattern)}


def _git(*arguments: str) -> str | None:
    """What git says; None if it is not there or refuses."""
    try:
        done = subprocess.run(
            ["git", "-C", str(HERE), *arguments], capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.strip()


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that the numbers depend on."""
    return {"python": platform.python_version()} | {name: version(name) for name in PACKAGES}


def version_properties(summary: dict[str, Any]) -> dict[str, str]:
    """Versions as properties: flat, and without the hyphens that their names may not have."""
    return {
        f"version_{name.replace('-', '_')}": value for name, value in summary["versions"].items()
    }
