"""Test the build of the kernels; a missing or outdated library gives a one-sentence error."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from hatch_build import Wheel
from kernels import build

ROOT = Path(__file__).parents[2]
SOURCES = sorted((ROOT / "kernels").glob("*.[ch]"))


@pytest.fixture
def copy(tmp_path):
    """Copy the folder alone, as it is installed."""
    place = tmp_path / "kernels"
    place.mkdir()
    for file in (ROOT / "kernels").iterdir():
        if file.is_file():
            shutil.copy(file, place)
    return place


def python(folder: Path, *labels: str, path: str | None = None) -> tuple[int, str]:
    """Return exit code and last line on standard error of the interpreter."""
    environment = {k: v for k, v in os.environ.items() if k not in ("CC", "FJH_KERNELS")}
    environment |= {"PYTHONPATH": str(folder), "PATH": os.environ["PATH"] if path is None else path}
    done = subprocess.run(
        [sys.executable, *labels], cwd=folder, env=environment, capture_output=True, text=True
    )
    return done.returncode, (done.stderr.strip().splitlines() or [""])[-1]


def test_a_missing_library_raises_one_sentence_with_advice(copy):
    (copy / build.LIBRARY.name).unlink()
    code, message = python(copy.parent, "-c", "import kernels")
    assert code == 1 and "is missing: compile the kernels of fjh first" in message


@pytest.mark.long  # it compiles all kernels
def test_a_library_of_other_sources_raises_until_it_is_rebuilt(copy):
    file = copy / "digest.c"
    file.write_text(file.read_text() + "\n")
    code, message = python(copy.parent, "-c", "import kernels")
    assert code == 1 and "was built from other sources: compile" in message
    assert python(copy.parent, str(copy / "build.py")) == (0, "")
    assert python(copy.parent, "-c", "import kernels") == (0, "")


def test_without_a_compiler_the_build_ends_with_one_sentence(copy, tmp_path):
    code, message = python(copy.parent, str(copy / "build.py"), path=str(tmp_path))
    assert code == 1
    assert message.startswith("fjh needs a C compiler to be installed, and found none")
    assert "ziglang" in message


@pytest.mark.long  # it compiles all kernels
def test_compiler_errors_are_one_sentence_without_partial_files(copy):
    (copy / "digest.c").write_text("mistake\n")
    code, message = python(copy.parent, str(copy / "build.py"))
    assert code == 1 and "cannot compile the kernels of fjh" in message and "mistake" in message
    assert not [file for file in copy.iterdir() if file.suffix == ".so" and file.name[0].isdigit()]


def test_the_package_build_requires_a_compiler_only_if_none_exists(monkeypatch):
    hook = Wheel(str(ROOT), {}, *[None] * 4)  # pyright: ignore[reportArgumentType]
    assert hook.dependencies() == []
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    assert hook.dependencies() == ["ziglang"]


@pytest.mark.parametrize("file", SOURCES, ids=lambda file: file.name)
def test_a_kernel_is_plain_c_without_warnings(file, tmp_path):
    flags = ["-std=c99", "-O2", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Wvla", "-Werror"]
    flags += ["-Wno-sign-conversion", '-DKERNELS_DIGEST="x"', "-fsyntax-only"]
    subprocess.run([*(build.compiler() or []), *flags, str(file)], check=True)


def test_kernels_call_mathematics_and_memory_functions_only():
    """Check that undefined symbols are those of libm, memory functions and the loader only."""
    listed = subprocess.run(["nm", "-D", "-u", str(build.LIBRARY)], capture_output=True, text=True)
    names = {line.split()[-1].split("@")[0] for line in listed.stdout.splitlines()}
    loader = {name for name in names if name.startswith(("_ITM", "__gmon", "__cxa_finalize"))}
    allowed = {"memcpy", "memset", "memmove", "__stack_chk_fail", "sqrt", "sin", "cos", "atan2"}
    allowed |= {"fmin", "fmax", "hypot", "ceil", "rint", "log", "exp", "pow", "frexp", "ldexp"}
    assert names - loader <= allowed
