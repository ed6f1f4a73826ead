"""Tests that unusable files are rejected in a sentence, without waiting, executing or writing."""

import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest

from tests.broken_files import (
    ARRAYS,
    CONTENTS,
    CUT_OFF,
    JSON,
    MODELS,
    NO_FILES,
    PATHS,
    TABLES,
    Spoil,
)
from tests.synthetic import write_synthetic_run

PUBLISHED = Path(__file__).parents[2] / "docs" / "data" / "table1.json"
# A reader: its file, the arguments of the command, and unusable kinds of files.
ANY = NO_FILES | CONTENTS
SOME_KINDS = {kind: ANY[kind] for kind in ("missing", "pipe", "endless", "pickled")}
"""Kinds of files for a reader with the code of another one."""
OTHERS = {kind: spoil for kind, spoil in NO_FILES.items() if kind != "missing"}
NO_MACHINE = {"no machine": MODELS["no machine"]}
READERS: dict[str, tuple[str, str, dict[str, Spoil]]] = {
    "review of a run": ("made.npz", "review {file} --out {out}/it.rrd", ANY | ARRAYS),
    "review of a folder": ("made.npz", "review {folder} --out {out}/it.rrd", OTHERS | CUT_OFF),
    "recording of a run": ("made.rrd", "review {folder} --out {out}/it.rrd", CONTENTS | CUT_OFF),
    "index of a run": ("made.json", "review {folder} --out {out}/it.rrd", OTHERS | CONTENTS | JSON),
    "review --model": ("it.xml", "review {folder} --model {file} --out {out}/it.rrd", NO_FILES),
    "animate": ("made.npz", "animate {file} --out {out}/it.gif", SOME_KINDS | CUT_OFF),
    "render": ("made.rrd", "render {file} --out {out}/it.png", NO_FILES),
    "results": ("result.json", "results {folder}", OTHERS | CONTENTS | JSON),
    "results against": ("result.json", f"results {PUBLISHED} --against {{file}}", ANY | JSON),
    "sweep --design": ("it.toml", "sweep --design {file} --out {out}", ANY),
    "sweep --resume": ("unfinished.jsonl", "sweep --resume --out {folder}", OTHERS | CONTENTS),
    "track MODEL": ("it.xml", "track {file} --out {out}", ANY | MODELS),
    "track --path": ("it.npz", "track --path {file} --out {out}", ANY | ARRAYS | PATHS),
    "table1 --model": ("it.xml", "table1 --model {file} --out {out}", SOME_KINDS | NO_MACHINE),
    "recover --model": ("it.xml", "recover --model {file} --out {out}", SOME_KINDS | NO_MACHINE),
    "figures --model": ("it.xml", "figures --model {file} --out {out}", SOME_KINDS | NO_MACHINE),
    "survey MODEL": ("it.xml", "survey {file} --out {out}", SOME_KINDS | NO_MACHINE),
    "survey --matrix": ("it.csv", "survey --matrix {file} --out {out}", ANY | TABLES),
    "live MODEL": ("it.xml", "live {file} --out {out}", SOME_KINDS | NO_MACHINE),
}


@pytest.fixture(scope="module")
def valid(tmp_path_factory) -> Path:
    """Folder with a valid file for each reader."""
    folder = tmp_path_factory.mktemp("healthy")
    write_synthetic_run(folder)
    np.savez(folder / "it.npz", time_s=np.arange(3.0), desired=np.zeros((3, 2)))
    return folder


@pytest.mark.parametrize(
    ("reader", "kind"),
    [(reader, kind) for reader, (_, _, kinds) in READERS.items() for kind in kinds],
)
def test_an_unusable_file_is_reported_in_one_sentence(
    refused, valid, tmp_path, monkeypatch, reader, kind
):
    name, command_line, kinds = READERS[reader]
    monkeypatch.chdir(tmp_path)
    folder = Path(shutil.copytree(valid, tmp_path / "in"))
    file = folder / name
    if kind not in (*CUT_OFF, "a flipped byte"):  # which alter a valid file
        file.unlink(missing_ok=True)
    kinds[kind](file)
    before = {*folder.iterdir()}
    arguments = command_line.format(file=f"in/{name}", folder="in", out="out")
    message = refused(*shlex.split(arguments))
    # A valid model is rejected by its content, and rows by their use.
    assert name in message or kind == "no machine" or "--resume" in message
    assert kind != "bomb" or "unpacks to" in message  # before it is unpacked
    assert [*tmp_path.iterdir()] == [folder] and {*folder.iterdir()} == before
