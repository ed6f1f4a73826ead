"""The kernels are built by the compiler that is there; what is missing or stale is one sentence."""

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
    """The folder alone, as it is installed."""
    place = tmp_path / "kernels"
    place.mkdir()
    for file in (ROOT / "kernels").iterdir():
        if file.is_file():
            shutil.copy(file, place)
    return place


def python(folder: Path, *labels: str, path: str | None = None) -> tuple[int, str]:
    """Exit code and last line on standard error of the interpreter."""
    environment = {k: v for k, v in os.environ.items() if k not in ("CC", "FJH_KERNELS")}
    environment |= {"PYTHONPATH": str(folder), "PATH": os.environ["PATH"] if path is None else path}
    done = subprocess.run(
        [sys.executable, *labels], cwd=folder, env=environment, capture_output=True, text=True
    )
    return done.returncode, (done.stderr.strip().splitlines() or [""])[-1]


def test_a_missing_library_is_one_sentence_that_says_what_to_do(copy):
    (copy / build.LIBRARY.name).unlink()
    code, message = python(copy.parent, "-c", "import kernels")
    assert code == 1 and "is missing: compile the kernels of fjh first" in message


@pytest.mark.long  # it compiles all kernels
def test_a_library_of_other_sources_is_refused_until_it_is_built_anew(copy):
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
def test_what_the_compiler_complains_of_is_one_sentence_and_nothing_half_built_is_left(copy):
    (copy / "digest.c").write_text("mistake\n")
    code, message = python(copy.parent, str(copy / "build.py"))
    assert code == 1 and "cannot compile the kernels of fjh" in message and "mistake" in message
    assert not [file for file in copy.iterdir() if file.suffix == ".so" and file.name[0].isdigit()]


def test_the_build_of_a_package_asks_for_a_compiler_only_where_there_is_none(monkeypatch):
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


def test_what_a_kernel_leaves_to_others_is_mathematics_and_copying():
    """No allocation, no input or output: no symbol is undefined but of libm, memory, the loader."""
    listed = subprocess.run(["nm", "-D", "-u", str(build.LIBRARY)], capture_output=True, text=True)
    names = {line.split()[-1].split("@")[0] for line in listed.stdout.splitlines()}
    loader = {name for name in names if name.startswith(("_ITM", "__gmon", "__cxa_finalize"))}
    allowed = {"memcpy", "memset", "memmove", "__stack_chk_fail", "sqrt", "sin", "cos", "atan2"}
    allowed |= {"fmin", "fmax", "hypot", "ceil", "rint", "log", "exp", "pow", "frexp", "ldexp"}
    assert names - loader <= allowed
