"""`make wheel-test`: build the wheel, install it step by step in an empty environment, use it.

`python tools/wheel.py FILE.whl` tests a given wheel. It needs a package index, so pytest does not
run it.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parents[1]
NOT_SOURCES = (
    *(".*_cache", ".git", ".hypothesis", ".venv", "*.egg-info", "__pycache__"),
    *("build", "dist", "results"),
)

BASE = """
import pkgutil, importlib
from importlib.util import find_spec
import fjh
from fjh import ftc, prioritized
rooms = "argument_checks", "experiments", "ftc", "kernels", "prioritized", "sim"
assert not any(map(find_spec, rooms))
assert not any(map(find_spec, ("mujoco", "rerun", "typer")))
for package in (ftc, prioritized):
    for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
        importlib.import_module(module.name)
system = prioritized.ConstrainedSystem([[1.0, 1.0, 0.5], [0.0, 1.0, 1.0]], None, [0, 1, 2])
failed = system.with_failures(locked=[0]).kinematics()
mapping = failed.velocity_mapping(major=[0])
rates = failed.expand(mapping([0.1]))
assert rates[0] == 0 and abs(rates[1] + 0.5 * rates[2] - 0.1) < 1e-15
print(mapping.status.value)
"""
"""Program of a user without a simulator, which imports every module available then."""

TYPED = """
import fjh
from fjh.ftc.control.mapping import Goal
from fjh.study.result import Result
from fjh.sim import Failure

a: int = fjh.ConstrainedSystem([[1.0]], None, [0])
b: int = Goal.__doc__
c: int = Failure.__name__
d: int = fjh.__version__
e: int = Result.__name__
"""
"""User's file with type errors in its last five lines, which a type checker must report."""


class Environment:
    """Virtual environment, and a folder from which its commands run."""

    def __init__(self, place: Path) -> None:
        self.bin, self.folder = place / "venv" / "bin", place / "user"
        self.folder.mkdir()
        run(sys.executable, "-m", "venv", str(place / "venv"), cwd=place)

    def __call__(self, command: str, *arguments: str, code: int = 0) -> str:
        """Run a command, which must end with this exit code; return its output."""
        return run(str(self.bin / command), *arguments, cwd=self.folder, code=code)

    def install(self, *requirements: str) -> None:
        """Install packages from the index, in the versions that CI uses."""
        options = ("--quiet", "--no-compile", "--constraint", str(ROOT / "constraints.txt"))
        self("python", "-m", "pip", "install", *options, *requirements)

    def build(self, place: Path) -> Path:
        """Build the wheel of a copy of the checkout, without files of former builds."""
        copy = shutil.copytree(ROOT, place / "copy", ignore=shutil.ignore_patterns(*NOT_SOURCES))
        options = ("--quiet", "--no-deps", "--wheel-dir", str(place))
        self("python", "-m", "pip", "wheel", *options, str(copy))
        (wheel,) = place.glob("*.whl")
        return wheel


def run(*args: str, cwd: Path, code: int = 0) -> str:
    """Run a command and return both output streams; exit if its exit code differs from `code`."""
    print("+", Path(args[0]).name, *(arg.replace("\n", "; ")[:60] for arg in args[1:]), flush=True)
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        args, cwd=cwd, env=environment, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )
    if done.returncode != code:
        sys.exit(f"exit code {done.returncode}, expected {code}:\n{done.stdout}")
    return done.stdout


def extra_of(sentence: str) -> str:
    """Return the extra that a one-line error message names."""
    lines = [line for line in sentence.splitlines() if not line.startswith(("  ", "Traceback"))]
    assert len(lines) == 1, sentence
    return re.findall(r'pip install "\.(\[\w+\])"', lines[0])[0]


def main() -> None:
    """Test the wheel; raise or exit with a message if it fails."""
    with TemporaryDirectory() as folder:
        user = Environment(Path(folder))
        wheel = Path(sys.argv[1]).resolve() if sys.argv[1:] else user.build(Path(folder))
        version = wheel.name.split("-")[1]

        user.install(str(wheel))
        assert user("python", "-c", BASE) == "the major task is met exactly\n"
        user.install(f"{wheel}{extra_of(user('python', '-c', 'import fjh.sim', code=1))}")
        assert user("python", "-c", "import fjh; print(fjh.load_model().nu)").endswith("6\n")
        user.install(f"{wheel}{extra_of(user('fjh', 'table1', code=2))}", "mypy")

        assert user("fjh", "--version") == f"fjh {version}\n"
        user("fjh", "table1", "--quick", "--quiet", "--out", "table1")
        assert (user.folder / "table1" / "table1.json").is_file()
        shutil.copy(ROOT / "models" / "arm.xml", user.folder / "yours.xml")
        text = (ROOT / "README.md").read_text(encoding="utf-8")
        blocks = re.findall(r"^```python\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
        print(user("python", "-c", "\n".join(blocks)), end="")
        (user.folder / "typed.py").write_text(TYPED)
        complaints = user("python", "-m", "mypy", "typed.py", code=1)
        errors = re.findall(r"^typed\.py:(\d+): error: .*\[(.*)\]$", complaints, re.MULTILINE)
        assert errors == [(str(line), "assignment") for line in range(7, 12)], complaints
    print(f"{wheel.name} installs and runs on Python {sys.version.split()[0]}")


if __name__ == "__main__":
    main()
