"""A mistyped name is answered with the nearest."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ARM = str(ROOT / "models" / "arm.xml")
MISTYPED = {
    "tabel1": "table1",
    "table1 --sed 3": "--seed",
    "table1 --jacobian analitic": "analytic",
    f"table1 --model {ARM[:-4]}.xlm": "no file",
    f"track {ARM.replace('arm', 'amr')}": "arm.xml",
    "track --event hardover:strut1@3": "hard_over",
    "track --controller json:lods": "loads",
    "sweep --design nowhere.toml": "nowhere.toml",
    "results nowhere.json --against nowhere.json": "nowhere.json",
    "review nowhere": "nowhere",
    "render nowhere.rrd --out it.png": "nowhere.rrd",
    "animate nowhere.npz --out it.gif": "nowhere.npz",
    f"track {ARM} --site paylaod": "payload",
    f"track {ARM} --axes bse": "base",
    f"track {ARM} --pinned paylaod:point": "payload",
    f"track {ARM} --fail joint44:locked@1": "joint4",
    f"recover --model {ARM} --site paylaod": "payload",
    f"survey {ARM} --site paylaod": "payload",
    "track --fail strt1:locked@1": "strut1",
    "track --fail strut1:loked@1": "locked",
    "track --event slow:strt1@3": "strut1",
    "track --path spirl": "spiral",
    "track --dither desinged": "designed",
}
CODE = """
import contextlib, io, json, os, sys
os.environ.setdefault("MUJOCO_GL", "disabled")
from experiments.app.cli import main
said = {}
for words in json.loads(sys.argv[1]):
    with contextlib.redirect_stderr(io.StringIO()) as error:
        code = main(words.split())
    said[words] = (code, error.getvalue())
print(json.dumps(said))
"""


@pytest.mark.long
def test_the_nearest_name_is_shown_and_nothing_is_written(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", CODE, json.dumps(list(MISTYPED))],
        cwd=tmp_path,
        env={"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    said = json.loads(done.stdout)
    for words, near in MISTYPED.items():
        code, error = said[words]
        assert code == 2, words
        assert near in error and error.count("\n") == 1, error
    assert list(tmp_path.iterdir()) == []
