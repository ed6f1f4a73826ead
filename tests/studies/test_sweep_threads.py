"""The bytes of a sweep do not depend on the threads that numerical libraries are given."""

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from experiments.study.campaign import simulate


def threads(_run: object) -> dict[str, int]:
    """How many each library has."""
    return {library["filepath"]: library["num_threads"] for library in threadpool_info()}


def test_a_row_is_computed_on_one_thread_in_any_process():
    with threadpool_limits(2):
        assert set(simulate(threads, SimpleNamespace(number=0)).values()) == {1}
        assert set(threads(None).values()) == {2}


@pytest.mark.long
def test_the_file_has_the_same_bytes(sweep_design, tmp_path):
    files = []
    for count in ("1", "2", "4"):
        out = tmp_path / count
        command = ("sweep", "--design", str(sweep_design), "--out", str(out))
        subprocess.run(
            [sys.executable, "-m", "experiments", *command],
            cwd=Path(__file__).parents[2],
            env=os.environ | {"OPENBLAS_NUM_THREADS": count},
            capture_output=True,
            check=True,
        )
        files.append((out / "sweep.parquet").read_bytes())
    assert len(set(files)) == 1
