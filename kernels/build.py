"""Compile the C sources of this folder into a shared library.

The installation (also `--editable`) and `make` call this. It needs no package: `cc` compiles, or
the compiler of the package `ziglang`.
"""

import hashlib
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

FOLDER = Path(__file__).parent
LIBRARY = FOLDER / ("_kernels.dll" if os.name == "nt" else "_kernels.so")
# Bit-identical results on every processor of a family: no fused multiply-add and no optional
# instructions. Without errno a square root is one instruction.
FLAGS = ("-std=c99", "-O3", "-ffp-contract=off", "-fno-math-errno", "-fPIC", "-shared")
SANITIZED = ("-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=undefined")
_MISSING = (
    "fjh needs a C compiler to be installed, and found none: install one (Debian and Ubuntu: "
    "apt install gcc libc6-dev; macOS: xcode-select --install), or the package ziglang"
)


class BuildError(RuntimeError):
    """Error of compiling the kernels; the message is one sentence."""


def digest() -> str:
    """Return the digest of the sources, which a library built from them contains."""
    text = b"".join(file.read_bytes() for file in sorted(FOLDER.glob("*.[ch]")))
    return hashlib.sha256(text).hexdigest()[:16]


def compiler() -> list[str] | None:
    """Return the command of a C compiler on this machine; None if there is none."""
    for name in filter(None, (os.environ.get("CC"), "cc", "gcc", "clang")):
        if shutil.which(name):
            return [name]
    return [sys.executable, "-m", "ziglang", "cc"] if find_spec("ziglang") else None


def build(library: Path = LIBRARY, flags: Sequence[str] = ()) -> None:
    """Compile the library, with further flags if given.

    Raises:
        BuildError: There is no compiler, or it fails.
    """
    command = compiler()
    if command is None:
        raise BuildError(_MISSING)
    library.parent.mkdir(parents=True, exist_ok=True)
    # Renamed when complete, because another process may be loading the old one.
    temporary = library.with_name(f"{os.getpid()}{library.name}")
    sources = sorted(map(str, FOLDER.glob("*.c")))
    define = f'-DKERNELS_DIGEST="{digest()}"'
    arguments = [*FLAGS, *flags, define, "-o", str(temporary), *sources, "-lm"]
    completed = subprocess.run([*command, *arguments], capture_output=True, text=True)
    if completed.returncode:
        temporary.unlink(missing_ok=True)
        message = " ".join(completed.stderr.split()) or f"exit code {completed.returncode}"
        raise BuildError(f"{' '.join(command)} cannot compile the kernels of fjh: {message}")
    temporary.replace(library)


if __name__ == "__main__":
    try:
        if "--sanitized" in sys.argv[1:]:
            build(FOLDER.parent / "build" / "sanitized" / LIBRARY.name, SANITIZED)
        else:
            build()
    except BuildError as error:
        sys.exit(str(error))
