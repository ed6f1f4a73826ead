"""Files of anybody's making: read, or refused in one sentence; nothing in them is executed."""

import io
import os
import pickle
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest
from numpy.lib.format import write_array_header_1_0 as write_header

from experiments.app.cli import main
from fjh.study.errors import WrongInput
from fjh.study.foreign import read_arrays, read_json
from fjh.study.spelling import LARGEST_FILE
from tests.made import keep_made


class Evil:
    """An object whose reading makes a folder."""

    def __reduce__(self):
        return os.mkdir, ("executed",)


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """A working folder in which nothing has been executed."""
    monkeypatch.chdir(tmp_path)
    yield
    assert not (tmp_path / "executed").exists()


def saved(array: object) -> bytes:
    file = io.BytesIO()
    np.save(file, np.asarray(array), allow_pickle=True)
    return file.getvalue()


def declared(shape: tuple[int, ...], descr: str = "<f8") -> bytes:
    """A header, and none of what it declares."""
    file = io.BytesIO()
    write_header(file, {"shape": shape, "fortran_order": False, "descr": descr})
    return file.getvalue()


def packed(path: Path, **entries: bytes) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in entries.items():
            file.writestr(f"{name}.npy", content)
    return path


def bomb(path: Path) -> None:
    """It says of itself that it unpacks to more than may be read."""
    packed(path, time_s=declared((LARGEST_FILE // 8,)) + bytes(1000))
    content = path.read_bytes()  # its directory is believed
    at = content.rindex(b"PK\x01\x02") + 24
    path.write_bytes(content[:at] + (LARGEST_FILE + 1).to_bytes(4, "little") + content[at + 4 :])


CRAFTED = {
    "objects": lambda path: packed(path, time_s=saved(np.array([Evil()], dtype=object))),
    "pickle": lambda path: path.write_bytes(pickle.dumps(Evil())),
    "beyond memory": lambda path: packed(path, time_s=declared((10**13,))),
    "cut off": lambda path: packed(path, time_s=declared((100,))),
    "negative": lambda path: packed(path, time_s=declared((-1,))),
    "empty": lambda path: path.write_bytes(b""),
    "one array": lambda path: path.write_bytes(saved([1.0])),
    "bomb": bomb,
    "pipe": os.mkfifo,
    "folder": Path.mkdir,
    "loop": lambda path: path.symlink_to(path),
    "endless": lambda path: path.symlink_to("/dev/zero"),
}


@pytest.mark.parametrize("kind", CRAFTED)
def test_arrays_are_refused_in_one_sentence(tmp_path, kind):
    file = tmp_path / "it.npz"
    CRAFTED[kind](file)
    with pytest.raises(WrongInput, match=r"it\.npz[^\n]*$"):
        read_arrays(file)


def test_what_is_no_array_is_none_of_numbers(tmp_path):
    found = read_arrays(packed(tmp_path / "it.npz", time_s=b"hello", x=saved([1.0])))
    assert found["time_s"].dtype.kind == "S" and found["x"] == [1.0]


@pytest.mark.parametrize("content", ["[" * 200_000, '{"a":' + "9" * 6000 + "}", "", "\x80"])
def test_json_is_refused_in_one_sentence(tmp_path, content):
    file = tmp_path / "it.json"
    file.write_bytes(content.encode("latin-1"))
    with pytest.raises(WrongInput, match=r"it\.json is not readable JSON$"):
        read_json(file)


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    folder = tmp_path_factory.mktemp("kept")
    keep_made(folder)
    return folder


SPOILT = {
    "made.npz": CRAFTED,
    "made.json": {kind: CRAFTED[kind] for kind in ("pipe", "folder", "loop", "endless")},
    "made.rrd": {
        "noise": lambda path: path.write_bytes(bytes(range(256)) * 4),
        **{
            f"without its last {lost} bytes": lambda path, lost=lost: os.truncate(
                path, path.stat().st_size - lost
            )
            for lost in (1, 30, 1000, 100_000)
        },
    },
}


@pytest.mark.parametrize(
    ("name", "kind"), [(name, kind) for name, kinds in SPOILT.items() for kind in kinds]
)
def test_review_says_one_sentence_of_a_crafted_folder(capfd, kept, tmp_path, name, kind):
    folder = Path(shutil.copytree(kept, tmp_path / "runs"))
    file, out = folder / name, tmp_path / "new" / "review.rrd"
    if name != "made.rrd":
        file.unlink(missing_ok=True)
    SPOILT[name][kind](file)
    assert main(["review", str(folder), "--out", str(out)]) == 2
    said = capfd.readouterr().err
    assert said.startswith("fjh: ") and name in said and said.count("\n") == 1
    assert not out.parent.exists()
