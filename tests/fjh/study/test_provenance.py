"""What a result states of the code that made it."""

import re
import subprocess

from fjh.study import provenance


def test_the_code_hash_changes_with_a_source_and_not_with_the_report(tmp_path, monkeypatch):
    monkeypatch.setattr(provenance, "ROOT", tmp_path)
    seen = {provenance.code_sha256()}
    rooms = ("argument_checks/a.py", "prioritized/a.py", "experiments/a.py")
    for name in ("sim/a.py", "sim/b/a.py", "models/a.xml", *rooms):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("1")
        seen.add(provenance.code_sha256())
    (tmp_path / "sim" / "a.py").write_text("2")
    seen.add(provenance.code_sha256())
    assert len(seen) == 8
    (tmp_path / "experiments" / "app").mkdir()
    (tmp_path / "experiments" / "app" / "page.py").write_text("1")
    assert provenance.code_sha256() in seen


def test_a_commit_is_named_only_in_the_projects_own_checkout(tmp_path, monkeypatch):
    assert re.match(r"[0-9a-f]{40}(, with uncommitted changes)?$|not a git", provenance.commit())
    monkeypatch.setattr(provenance, "HERE", tmp_path)
    assert provenance.commit() == "not a git checkout"
    subprocess.run(["git", "init", "-q", str(tmp_path)], check=True)
    assert provenance.commit() == "not a git checkout"
