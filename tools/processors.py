"""`make test-processors`: run the short tests with the arithmetic of other processors.

The last bits of a sum depend on the order of its terms, which OpenBLAS and numpy choose by the
processor and the number of threads. Each setting forces a choice; the last reverses the test files.

    python tools/processors.py [NAME ...]    these settings, or all; exit code: number that failed
"""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
KERNELS = ("Nehalem", "Sandybridge", "Haswell", "Zen", "SkylakeX")
"""Kernels of OpenBLAS, for processors of 2008 (SSE4) to 2017 (AVX-512)."""

LOADED = """
import numpy, scipy.linalg, threadpoolctl
numpy.linalg.svd(numpy.ones((50, 50)))
print(*sorted({pool["architecture"] for pool in threadpoolctl.threadpool_info()}))
"""
FEATURES = "import numpy; print(*numpy.show_config(mode='dicts')['SIMD Extensions']['found'])"


def output(code: str, **environment: str) -> str:
    """Return what a Python program prints, or an empty string if it fails."""
    ran = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | environment, capture_output=True, text=True
    )
    return "" if ran.returncode else ran.stdout.strip()


def settings() -> dict[str, dict[str, str]]:
    """Return environment variables by setting; kernels equal on this machine appear once."""
    kernels: dict[str, str] = {}
    for kernel in KERNELS:
        if loaded := output(LOADED, OPENBLAS_CORETYPE=kernel):
            kernels.setdefault(loaded, kernel)
    variables = {kernel: {"OPENBLAS_CORETYPE": kernel} for kernel in kernels.values()}
    wide = [name for name in output(FEATURES).split() if name[:4] in ("AVX2", "FMA3", "AVX5")]
    variables["no-avx2-fma3"] = {"NPY_DISABLE_CPU_FEATURES": " ".join(wide)}
    return variables | {"two-threads": {"OPENBLAS_NUM_THREADS": "2"}, "reversed": {}}


def run(name: str, environment: dict[str, str]) -> bool:
    """Run the short tests with some environment variables; return whether they pass."""
    print(f"== {name}: {environment or 'test files from the last to the first'}", flush=True)
    files = sorted(str(path.relative_to(ROOT)) for path in (ROOT / "tests").rglob("test_*.py"))
    order = ["--no-loadscope-reorder", *reversed(files)] if name == "reversed" else []
    args = ("--numprocesses", "auto", "--dist", "loadfile", "--quiet", "-m", "not long", *order)
    # Other kernels are slower.
    environment = {"OPENBLAS_NUM_THREADS": "1", "PROCESSOR_TIME": "unlimited"} | environment
    pytest = [sys.executable, "-m", "pytest", *args]
    code = subprocess.run(pytest, cwd=ROOT, env=os.environ | environment).returncode
    print(f"== {name}: {f'FAILED, exit code {code}' if code else 'passed'}", flush=True)
    return code == 0


def main() -> int:
    """Run the settings of the command line; return the number in which a test failed."""
    available = settings()
    chosen = sys.argv[1:] or list(available)
    if unknown := set(chosen) - set(available):
        sys.exit(f"no setting {', '.join(sorted(unknown))}; here are {', '.join(available)}")
    failed = [name for name in chosen if not run(name, available[name])]
    print(f"{len(chosen) - len(failed)} of {len(chosen)} settings passed", *failed, sep="\n")
    return len(failed)


if __name__ == "__main__":
    sys.exit(main())
