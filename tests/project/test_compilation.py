"""Half a minute of compilation is announced; what lies in the cache is loaded without a word."""

import importlib.util
import sys

import numpy as np
import pytest

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
