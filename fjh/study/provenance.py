"""Provenance of results: computer, commit, package versions, and a hash of the code."""

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
"""Files of the report, which determine no numbers and are left out of the hash of the code."""

PACKAGES = ("mujoco", "numpy", "scipy", "control", "rerun-sdk", "matplotlib")


def machine() -> dict[str, Any]:
    """Return processor, cores, memory and operating system of this computer."""
    return {
        "processor": processor(),
        "cores": psutil.cpu_count(logical=False) or os.cpu_count(),
        "threads": os.cpu_count(),
        "memory_gib": round(psutil.virtual_memory().total / 2**30, 1),
        "system": platform.platform(),
    }


def processor() -> str:
    """Return the name of the processor, or what the system states instead."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return next(iter(names), platform.processor() or platform.machine())


def commit() -> str:
    """Return the commit of this checkout, and whether it has uncommitted changes."""
    # An installation inside another checkout is not tracked by it.
    if _git("ls-files", "--error-unmatch", __file__) is None:
        return "not a git checkout"
    changes = ", with uncommitted changes" if _git("status", "--porcelain") else ""
    return f"{_git('rev-parse', 'HEAD')}{changes}"


def code_sha256() -> str:
    """Return the SHA-256 over names and contents of the source files that determine numbers."""
    digest = hashlib.sha256()
    for file in sorted(_matching(_SOURCES) - _matching(_REPORT)):
        digest.update(f"{file.relative_to(ROOT).as_posix()}\0".encode())
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def _matching(patterns: Iterable[str]) -> set[Path]:
    return {file for pattern in patterns for file in ROOT.glob(pattern)}


def _git(*arguments: str) -> str | None:
    try:
        done = subprocess.run(
            ["git", "-C", str(HERE), *arguments], capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.strip()


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that the numbers depend on."""
    return {"python": platform.python_version()} | {name: version(name) for name in PACKAGES}


def version_properties(summary: dict[str, Any]) -> dict[str, str]:
    """Return the package versions in a summary as properties, with names of underscores."""
    return {
        f"version_{name.replace('-', '_')}": value for name, value in summary["versions"].items()
    }
