"""A cluster is encrypted, or of this computer, or warned of; and who computes on this one."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from experiments.study import cluster
from experiments.study.parallel import CORES
from experiments.study.study import WrongInput
from experiments.study.where import Where

OPEN = ["tcp://head:8786", "head:8786", "tcp://192.168.0.3:8786", "ws://10.0.0.1:1", "tcp://:8786"]
PRIVATE = ["tls://head:8786", "tcp://127.0.0.1:8786", "tcp://localhost:8786", "tcp://[::1]:8786"]
TLS = """
import subprocess, sys, warnings
from distributed import LocalCluster, Security
from experiments.app.cli import main
if __name__ == "__main__":
    with LocalCluster(
        n_workers=1, threads_per_worker=1, host="tls://127.0.0.1", dashboard_address=None,
        protocol="tls://", security=Security(), silence_logs=50,
    ) as crew:
        words = ["sweep", "--design", sys.argv[1], "--scheduler", crew.scheduler_address]
        code = main([*words, "--out", sys.argv[2]])
        plain = main([*words[:-1], crew.scheduler_address.replace("tls", "tcp"), "--out", "none"])
    print(code, plain)
"""


def test_who_can_reach_a_scheduler_is_seen_from_its_address():
    assert not any(map(cluster.is_private, OPEN))
    assert all(map(cluster.is_private, PRIVATE))


@pytest.mark.parametrize("address", [OPEN[0], PRIVATE[0]])
def test_one_that_others_can_reach_is_warned_of_in_one_sentence(address, capsys, monkeypatch):
    async def answers(address: str) -> None:
        pass

    def refuses(*_: object, **__: object) -> None:
        raise OSError("no client here")

    monkeypatch.setattr(cluster, "_check_scheduler", answers)
    monkeypatch.setattr(cluster, "Client", refuses)
    with (
        pytest.raises(WrongInput, match="no client here"),
        cluster.cluster(address, None),  # type: ignore[arg-type]
    ):
        pass
    said = capsys.readouterr().err
    if address in PRIVATE:
        assert said == ""
    else:
        assert said.startswith(f"fjh: --scheduler {address} is not encrypted: whoever reaches ")
        assert said.count("\n") == 1


@pytest.mark.long
@pytest.mark.skipif(not shutil.which("openssl"), reason="certificates are made by openssl")
def test_a_sweep_over_tls_with_a_certificate_made_as_documented(sweep_design, tmp_path):
    page = (Path(__file__).parents[2] / "docs" / "security.md").read_text()
    [made] = [block.split("```")[0] for block in page.split("```sh\n") if "openssl" in block[:9]]
    (tmp_path / "tls.py").write_text(TLS)
    ran = f"{made}\nexec {sys.executable} tls.py {sweep_design} out"
    root = str(Path(__file__).parents[2])
    done = subprocess.run(
        ["bash", "-ec", ran],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": root},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.endswith("\n0 2\n"), done.stderr
    assert (tmp_path / "out" / "sweep.parquet").exists()


def test_no_more_processes_than_cores(capsys):
    assert Where(workers=1000).processes == CORES
    assert capsys.readouterr().err == (
        f"fjh: --workers 1000 are more than the cores: {CORES} are used; "
        "a Dask scheduler takes any number\n"
    )
    assert Where(workers=1).processes == 1
    assert Where().processes == CORES
    assert capsys.readouterr().err == ""
