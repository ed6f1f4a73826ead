"""A file is used, or refused in a sentence: nothing is waited for, executed or written."""

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
from tests.made import keep_made

PUBLISHED = Path(__file__).parents[2] / "docs" / "data" / "table1.json"
# A reader: its file, the words of the command, and what it cannot use.
ANY = NO_FILES | CONTENTS
SOME = {kind: ANY[kind] for kind in ("missing", "pipe", "endless", "pickled")}
"""Of a reader that reads as another one does."""
BESIDE = {kind: each for kind, each in NO_FILES.items() if kind != "missing"}
NO_MACHINE = {"no machine": MODELS["no machine"]}
READERS: dict[str, tuple[str, str, dict[str, Spoil]]] = {
    "review of a run": ("made.npz", "review {file} --out {out}/it.rrd", ANY | ARRAYS),
    "review of a folder": ("made.npz", "review {folder} --out {out}/it.rrd", BESIDE | CUT_OFF),
    "recording of a run": ("made.rrd", "review {folder} --out {out}/it.rrd", CONTENTS | CUT_OFF),
    "index of a run": ("made.json", "review {folder} --out {out}/it.rrd", BESIDE | CONTENTS | JSON),
    "review --model": ("it.xml", "review {folder} --model {file} --out {out}/it.rrd", NO_FILES),
    "animate": ("made.npz", "animate {file} --out {out}/it.gif", SOME | CUT_OFF),
    "render": ("made.rrd", "render {file} --out {out}/it.png", NO_FILES),
    "results": ("result.json", "results {folder}", BESIDE | CONTENTS | JSON),
    "results against": ("result.json", f"results {PUBLISHED} --against {{file}}", ANY | JSON),
    "sweep --design": ("it.toml", "sweep --design {file} --out {out}", ANY),
    "sweep --resume": ("unfinished.jsonl", "sweep --resume --out {folder}", BESIDE | CONTENTS),
    "track MODEL": ("it.xml", "track {file} --out {out}", ANY | MODELS),
    "track --path": ("it.npz", "track --path {file} --out {out}", ANY | ARRAYS | PATHS),
    "table1 --model": ("it.xml", "table1 --model {file} --out {out}", SOME | NO_MACHINE),
    "recover --model": ("it.xml", "recover --model {file} --out {out}", SOME | NO_MACHINE),
    "figures --model": ("it.xml", "figures --model {file} --out {out}", SOME | NO_MACHINE),
    "survey MODEL": ("it.xml", "survey {file} --out {out}", SOME | NO_MACHINE),
    "survey --matrix": ("it.csv", "survey --matrix {file} --out {out}", ANY | TABLES),
    "live MODEL": ("it.xml", "live {file} --out {out}", SOME | NO_MACHINE),
}


@pytest.fixture(scope="module")
def sound(tmp_path_factory) -> Path:
    """A folder with a sound file for each reader that may find it broken."""
    folder = tmp_path_factory.mktemp("sound")
    keep_made(folder)
    np.savez(folder / "it.npz", time_s=np.arange(3.0), desired=np.zeros((3, 2)))
    return folder


@pytest.mark.parametrize(
    ("reader", "kind"),
    [(reader, kind) for reader, (_, _, kinds) in READERS.items() for kind in kinds],
)
def test_a_file_that_cannot_be_used_is_named_in_one_sentence(
    refused, sound, tmp_path, monkeypatch, reader, kind
):
    name, words, kinds = READERS[reader]
    monkeypatch.chdir(tmp_path)
    folder = Path(shutil.copytree(sound, tmp_path / "in"))
    file = folder / name
    if kind not in (*CUT_OFF, "a flipped byte"):  # which spoil a sound file
        file.unlink(missing_ok=True)
    kinds[kind](file)
    before = {*folder.iterdir()}
    given = words.format(file=f"in/{name}", folder="in", out="out")
    said = refused(*shlex.split(given))
    # A machine of a sound format is refused by what it lacks, and rows by how they were to be used.
    assert name in said or kind == "no machine" or "--resume" in said
    assert kind != "bomb" or "unpacks to" in said  # before it is unpacked
    assert [*tmp_path.iterdir()] == [folder] and {*folder.iterdir()} == before
