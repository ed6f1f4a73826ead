"""Half a minute of compilation is announced; what lies in the cache is loaded without a word.

A cache that cannot be used is one sentence, and everything works without it.
"""

import importlib.util
import re
import resource
import sys
from pathlib import Path

import numpy as np
import pytest

from argument_checks import compilation
from argument_checks.compilation import NOTICE, announce

KERNELS = """
from numba import njit, types

from argument_checks.compilation import kernel

half = njit(lambda x: x / 2)

@kernel(types.float64(types.float64))
def first(x):
    return 1 / x

@kernel(types.float64(types.float64))
def second(x):
    return -x
"""


@pytest.fixture
def loaded(tmp_path, monkeypatch):
    """Import the module anew, as a new process does; numba caches it beside the file."""
    file = tmp_path / "kernels.py"
    file.write_text(KERNELS)

    def load():
        announce.cache_clear()
        compilation._complaints.clear()
        spec = importlib.util.spec_from_file_location("kernels", file)
        assert spec and spec.loader
        module = importlib.util.module_from_spec(spec)
        monkeypatch.setitem(sys.modules, "kernels", module)
        spec.loader.exec_module(module)
        return module

    return load


def test_compilation_is_one_record_and_a_warm_cache_is_silent(loaded, caplog):
    assert loaded().first(4.0) == 0.25
    assert caplog.messages == [NOTICE]
    caplog.clear()
    again = loaded()
    assert again.first(0.0) == np.inf
    assert again.second(2.0) == -2.0
    assert again.half(3.0) == 1.5  # of the user's own; compiled when it is called
    assert caplog.messages == []


CALLER = """
import sys

from numba import types

from argument_checks.compilation import kernel

kernels = sys.modules["kernels"]
called = kernels.first

@kernel(types.float64(types.float64), calls=(kernels,))
def twice(x):
    return called(called(x))
"""


def test_what_calls_a_kernel_of_another_file_is_compiled_anew_when_that_changes(
    loaded, tmp_path, monkeypatch, caplog
):
    def twice(x: float) -> float:
        loaded()
        spec = importlib.util.spec_from_file_location("caller", tmp_path / "caller.py")
        assert spec and spec.loader
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module.twice(x)

    (tmp_path / "caller.py").write_text(CALLER)
    assert twice(4.0) == 4.0
    caplog.clear()
    assert twice(8.0) == 8.0
    assert caplog.messages == []
    # Of another length: Python's own cache compares the size and whole seconds.
    (tmp_path / "kernels.py").write_text(KERNELS.replace("1 / x", "3.0 + x"))
    assert twice(4.0) == 10.0


def works(module) -> bool:
    return module.first(4.0) == 0.25 and module.second(2.0) == -2.0


def cached(folder: Path, pattern: str) -> list[Path]:
    found = sorted((folder / "__pycache__").glob(pattern))
    assert found
    return found


def complaint(messages: list[str]) -> str:
    """The only one; that something is compiled is another sentence."""
    (said,) = (each for each in messages if each != NOTICE)
    return said


@pytest.mark.parametrize("pattern", ["*first*.nbi", "*first*.nbc", "*.nb?"])
@pytest.mark.parametrize("content", [b"", b"\x80", b"no pickle", b"\x80\x04\x95"])
def test_a_damaged_cache_is_one_sentence_and_nothing_depends_on_it(
    loaded, caplog, tmp_path, pattern, content
):
    loaded()
    for file in cached(tmp_path, pattern):
        file.write_bytes(content)
    caplog.clear()
    assert works(loaded())
    said = complaint(caplog.messages)
    assert str(tmp_path / "__pycache__") in said and "\n" not in said
    for file in cached(tmp_path, "*.nb?"):
        file.unlink()
    assert works(loaded())
    caplog.clear()
    assert works(loaded())
    assert caplog.messages == []


def test_a_cache_cut_off_anywhere_is_a_damaged_one(loaded, caplog, tmp_path):
    loaded()
    (index,), (data,) = cached(tmp_path, "*first*.nbi"), cached(tmp_path, "*first*.nbc")
    for file in (index, data):
        whole = file.read_bytes()
        for part in (1, len(whole) // 2, len(whole) - 1):
            file.write_bytes(whole[:part])
            caplog.clear()
            assert works(loaded())
            assert complaint(caplog.messages)
        file.write_bytes(whole)


def test_a_full_disk_is_one_sentence(loaded, caplog):
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (16, before[1]))
    try:
        module = loaded()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert works(module)
    assert "OSError" in complaint(caplog.messages)


def test_where_no_folder_may_be_written_to_that_is_one_sentence(
    loaded, caplog, tmp_path, monkeypatch
):
    """Beside the package and in the user's home there are files where the folders would be."""
    (tmp_path / "__pycache__").write_text("")
    (tmp_path / "home").write_text("")
    for name in ("HOME", "XDG_CACHE_HOME"):
        monkeypatch.setenv(name, str(tmp_path / "home"))
    assert works(loaded())
    assert re.search(r"cache of numba cannot be used .*kernels\.py", complaint(caplog.messages))


def test_a_mistake_in_a_function_is_no_matter_of_the_cache(loaded, caplog, tmp_path):
    with pytest.raises(Exception, match="nowhere"):
        compilation.kernel("float64(float64)")(lambda x: nowhere(x))  # noqa: F821  # pyright: ignore
    assert [each for each in caplog.messages if each != NOTICE] == []


def test_make_venv_compiles_everything_so_that_no_test_waits_for_it():
    root = Path(__file__).parents[2]
    line = next(x for x in (root / "Makefile").read_text().splitlines() if "import bounded" in x)
    named = set(re.findall(r"\w+", line))
    kernels = {
        file.stem
        for room in ("prioritized", "sim", "ftc", "experiments")
        for file in (root / room).rglob("*.py")
        if re.search(r"^@kernel\(", file.read_text(), re.MULTILINE)
    }
    assert len(kernels) >= 11 and kernels - named == set()
