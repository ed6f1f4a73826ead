"""Schedulers that are none or have no workers, and benches that nobody could build."""

import gc
import socket
import threading
import time
import warnings
from contextlib import closing, contextmanager
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from distributed import Client, LocalCluster
from typer.testing import CliRunner

from experiments.app.cli import app_of, main
from experiments.rig.hexapod.testbed import LIMITS, TestbedConfig
from experiments.study import cluster as clusters
from experiments.study.campaign import Campaign
from experiments.study.study import Unsound, WrongInput
from experiments.sweep.campaign import SOURCES
from experiments.sweep.design import read_design
from experiments.sweep.row import SCHEMA
from experiments.sweep.sweep_run import KINDS
from experiments.sweep.sweep_run import LIMITS as VARIED

# Schedulers.


def refusal(capsys, tmp_path, *words: str) -> str:
    """What a command says that leaves nothing behind."""
    assert main([*words, "--quick", "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert not (tmp_path / "out").exists()
    return said.err


@pytest.mark.parametrize("command", ["sweep", "atlas"])
@pytest.mark.parametrize("address", [" ", "tcp://a b:1", "tcp://a:1\n"])
def test_what_cannot_be_an_address_is_refused(capsys, tmp_path, command, address):
    said = refusal(capsys, tmp_path, command, "--scheduler", address)
    assert said == (f"fjh: --scheduler must be an address, as tls://host:8786, got {address!r}\n")
    said = refusal(capsys, tmp_path, command, "--scheduler", "")
    assert said == "fjh: --scheduler is empty, expected a value\n"


@contextmanager
def listening(answer: bytes):
    """The port of a program that answers every caller alike."""
    with closing(socket.create_server(("127.0.0.1", 0))) as server:
        callers = []

        def serve():
            try:
                while True:
                    callers.append(server.accept()[0])
                    callers[-1].sendall(answer)
            except OSError:  # closed
                pass

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield server.getsockname()[1]
        finally:
            server.shutdown(socket.SHUT_RDWR)
            thread.join()
            for caller in callers:
                caller.close()


@pytest.mark.parametrize("scheme", ["tcp", "tls", "ws", "http", "ucx"])
@pytest.mark.parametrize("answer", [b"", b"HTTP/1.0 400 Bad request\r\n\r\n"])
def test_what_is_no_scheduler_is_refused_in_one_sentence(
    capsys, tmp_path, monkeypatch, scheme, answer
):
    """A silent one, too, and a dashboard's port instead of the scheduler's."""
    monkeypatch.setattr(clusters, "ANSWERS_IN_S", 0.1)
    with listening(answer) as port:
        address = f"{scheme}://127.0.0.1:{port}"
        said = refusal(capsys, tmp_path, "sweep", "--scheduler", address)
        with warnings.catch_warnings(action="ignore", category=ResourceWarning):
            gc.collect()  # Dask leaves some of its sockets to it
    assert said.startswith(f"fjh: --scheduler {address} does not answer: ")
    assert said.count("\n") == 1


def without_workers() -> Any:
    """A scheduler in this process."""
    return LocalCluster(
        n_workers=0,
        threads_per_worker=1,
        processes=False,
        protocol="tcp://",
        host="127.0.0.1",
        dashboard_address="127.0.0.1:0",
    )


@pytest.fixture(scope="module")
def idle():
    with without_workers() as cluster:
        yield cluster


@pytest.fixture
def impatient(monkeypatch):
    monkeypatch.setattr(clusters, "PATIENCE_S", 0.3)
    monkeypatch.setattr(clusters, "LOOK_EVERY_S", 0.05)


@pytest.mark.parametrize("command", ["sweep", "atlas"])
def test_a_scheduler_without_workers_is_said_at_once_and_given_up(
    capsys, tmp_path, idle, impatient, command
):
    said = refusal(capsys, tmp_path, command, "--scheduler", idle.scheduler_address)
    first, second, end = said.split("\n")
    assert first == "fjh: the scheduler has no workers; waiting up to 0.3 s for one"
    assert second.startswith("fjh: the scheduler has had no workers for 0.3 s: start some")
    assert end == ""


def test_the_help_says_how_long_a_scheduler_may_be_without_workers():
    for command in ("sweep", "atlas", "recover"):
        text = " ".join(CliRunner().invoke(app_of(command), [command, "--help"]).output.split())
        assert f"fails after {clusters.PATIENCE_S:g} s without a worker" in text


def test_a_worker_that_comes_while_we_wait_is_taken(idle, monkeypatch):
    said = []

    def start_one(sentence):
        said.append(sentence)
        idle.scale(1)

    monkeypatch.setattr(clusters, "notice", start_one)
    with Client(idle.scheduler_address) as client:
        clusters.wait_for_worker(client)
        clusters.wait_for_worker(client)
        idle.scale(0)
    assert len(said) == 1


def test_a_worker_is_no_scheduler(idle, capsys, tmp_path):
    idle.scale(1)
    with Client(idle.scheduler_address) as client:
        client.wait_for_workers(1)
        ran: Any = client.run(lambda: None)
        [address] = ran
        said = refusal(capsys, tmp_path, "sweep", "--scheduler", address)
        idle.scale(0)
    assert said == f"fjh: --scheduler {address} does not answer: it is a Worker\n"


LEFT = threading.Event()


def only_the_first(number):
    """Its row; the others are not done before all workers have left."""
    return {"case": number, "left": number > 0 and LEFT.wait(20)}


def test_when_all_workers_leave_a_running_sweep_it_is_said_and_given_up(idle, impatient, capsys):
    """What has come by then is kept by whoever takes the rows."""
    numbers = range(4)
    campaign = Campaign(numbers, only_the_first, SCHEMA, SOURCES, {})
    idle.scale(1)
    with Client(idle.scheduler_address) as client:
        client.wait_for_workers(1)
        rows = clusters.finished_rows(client, campaign, numbers)
        assert next(rows)["case"] == 0
        idle.scale(0)
        while client.scheduler_info(n_workers=0)["n_workers"]:
            time.sleep(0.02)
        LEFT.set()
        with pytest.raises(WrongInput, match="finished runs are kept, and --resume continues"):
            list(rows)
    assert "waiting up to 0.3 s" in capsys.readouterr().err


def test_a_scheduler_that_goes_while_we_wait_is_one_sentence(monkeypatch):
    with without_workers() as cluster, Client(cluster.scheduler_address, timeout=0.3) as client:
        monkeypatch.setattr(clusters, "notice", lambda sentence: cluster.close())
        with pytest.raises(Unsound, match="the connection to the scheduler is lost"):
            clusters.wait_for_worker(client)


# Benches.


@pytest.mark.parametrize("name", LIMITS)
def test_a_bench_has_no_constant_beyond_its_limits(name):
    low, high = LIMITS[name]
    for value in (low, high):
        constant: Any = {name: value}
        assert getattr(TestbedConfig(**constant), name) == value
    beyond = [low - 1, np.nextafter(low, -np.inf), np.nextafter(high, np.inf), 10**400]
    others = [np.nan, np.inf, -np.inf, True, "1", [1.0], 1j]
    if name != "demand_limit_urad":  # where None is no limit
        others.append(None)
    for value in [*beyond, *others]:
        with pytest.raises(ValueError, match=rf"{name} must be a .*number from .* to .*, got"):
            replace(TestbedConfig(), **{name: value})


def test_every_constant_has_its_limits_and_converters_have_whole_bits():
    choices = {"spiral_direction", "anti_windup"}
    assert set(LIMITS) | choices == {field.name for field in fields(TestbedConfig)}
    assert set(VARIED) == {name for name in KINDS if KINDS[name] in ("real", "integer")}
    bits: Any = {"dac_bits": 16.5}
    with pytest.raises(ValueError, match="must be a whole number from 2 to 32"):
        replace(TestbedConfig(), **bits)


HUGE = "1" + 400 * "0"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("vary.dac_bits = 99999", "dac_bits must be a whole number from 2 to 32, got 99999"),
        ("vary.dac_bits = [16, 0]", "dac_bits must be a whole number from 2 to 32, got 0"),
        ("vary.dac_bits = 16.0", "dac_bits must be a whole number from 2 to 32, got 16.0"),
        ("vary.spiral_direction = 0", "spiral_direction must be 1 or -1, got 0"),
        ("vary.spiral_direction = [1, true]", "spiral_direction must be 1 or -1, got True"),
        (
            "vary.spiral_direction = {from = -1, to = 1, points = 2}",
            "spiral_direction must be a list of values, got a range",
        ),
        ("vary.anti_windup = 1", "anti_windup must be true or false, got 1"),
        ("vary.demand_limit_urad = 0", "demand_limit_urad must be a number from 0.001 to"),
        (
            "vary.settling_s = 1e12",
            "settling_s must be a number from 0.001 to 3600, got 1000000000000",
        ),
        (f"vary.settling_s = {HUGE}", "settling_s must be a number from 0.001 to 3600, got 10"),
        (f"duration_s = {HUGE}\nvary.seed = [1]", "duration_s must be a number from 0.001 to 16"),
        (f"vary.seed = [{HUGE}]", "seed must be a whole number from 0 to"),
        ("vary.failure_time_s = 1e12", "failure_time_s must be a number from 0 to 3600"),
        ("vary.joint_weight_1 = 1e300", "joint_weight_1 must be a number from 0 to 1e"),
        ("vary.focal_length_m = nan", "focal_length_m must be a number .* got nan"),
        ("vary.roll_off_hz = {from = 1, to = 1e9, points = 2}", "roll_off_hz must .* got 1"),
        (
            "vary.roll_off_hz = {from = 1, to = 2, points = 1_000_000_000_000}",
            "at most 10000000 runs",
        ),
        (
            "duration_s = 0.02\nvary.control_period_s = [1e-3, 0.05]",
            "duration_s must be a number from 0.05 to 16, got 0.02",
        ),
        (f"vary.dac_bits = 0x{'f' * 6000}", "dac_bits must be a whole number .* a huge int"),
        (f"vary.dac_bits = {'9' * 6000}", "is not TOML: .*4300"),
        (f"vary.seed = {'[' * 100_000}", "is not TOML"),
    ],
)
def test_a_design_beyond_what_can_be_built_is_refused_before_any_run(capsys, tmp_path, text, said):
    file = tmp_path / "design.toml"
    file.write_text(f"layout = 'grid'\n{text}")
    with pytest.raises(WrongInput, match=said) as wrong:
        read_design(file)
    assert "\n" not in str(wrong.value)
    told = refusal(capsys, tmp_path, "sweep", "--design", str(file))
    assert told.startswith(f"fjh: --design {file}")
