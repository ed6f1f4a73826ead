"""A mistyped name is answered with the nearest; if it is none of a robot, at once."""

import json
import subprocess
import sys
from pathlib import Path

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
    "compare nowhere.json nowhere.json": "nowhere.json",
    "review nowhere": "nowhere",
    "render nowhere.rrd --out it.png": "nowhere.rrd",
    "animate nowhere.npz --out it.gif": "nowhere.npz",
}
OF_A_ROBOT = {
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
slow = {"cffi", "scipy", "control", "matplotlib", "ftc", "sim", "prioritized", "pyarrow", "rerun"}
print(json.dumps([said, sorted(slow & set(sys.modules))]))
"""


def test_the_nearest_name_is_shown_before_anything_slow_is_imported(tmp_path):
    said, slow = answers(tmp_path, MISTYPED)
    assert slow == []
    check_nearest(tmp_path, said, MISTYPED)


def test_the_nearest_name_of_a_robot_is_shown(tmp_path):
    said, _ = answers(tmp_path, OF_A_ROBOT)
    check_nearest(tmp_path, said, OF_A_ROBOT)


def answers(folder: Path, words: dict[str, str]) -> tuple[dict[str, tuple[int, str]], list[str]]:
    """Exit code and text of each command in one process, and what of the slow it has imported."""
    done = subprocess.run(
        [sys.executable, "-c", CODE, json.dumps(list(words))],
        cwd=folder,
        env={"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout)


def check_nearest(folder: Path, said: dict[str, tuple[int, str]], expected: dict[str, str]) -> None:
    """One sentence each, exit code 2, and nothing written."""
    for words, near in expected.items():
        code, error = said[words]
        assert code == 2, words
        assert near in error and error.count("\n") == 1, error
    assert list(folder.iterdir()) == []
