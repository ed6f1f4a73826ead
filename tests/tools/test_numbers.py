"""Tests of the copying of results to docs/data, on small results."""

import json

import pandas as pd
import pytest

from tools import numbers


def chapter(name: str, study: str) -> dict:
    return {"name": name, "study": study, "finished": "2026-01-01", "wall_time_s": 1.0} | {
        "complaint": ""
    }


@pytest.fixture
def results(tmp_path, monkeypatch):
    """Folder with the results of two chapters of one study, robots and times."""
    facts = {"quick": False, "missing": [], "commit": "abc", "seed": 0, "versions": {}}
    facts |= {"machine": {}}
    chapters = [chapter("recover", "recover"), chapter("events", "recover")]
    for folder, listed in {"studies": chapters, "robots/failures": []}.items():
        (tmp_path / folder).mkdir(parents=True)
        report = json.dumps(facts | {"chapters": listed})
        (tmp_path / folder / "report.json").write_text(report)
    for entry in chapters:
        folder = tmp_path / "studies" / entry["name"]
        folder.mkdir()
        content = {"experiment": "recover", "runs": 1, "dataset": "recover.parquet"}
        (folder / "recover.json").write_text(json.dumps(content | {"name": entry["name"]}))
        pd.DataFrame({"case": [0]}).to_parquet(folder / "recover.parquet")
    refused = {"package": "dm-control", "name": "x", "stage": "load", "refused": "no"}
    refused |= {"finished": "2026-01-01", "commit": "abc"}
    (tmp_path / "robots" / "robots.json").write_text(json.dumps([refused]))
    times = {"extra_info": {"question": "problem_1", "name": "ours", "units": 2}}
    times |= {"stats": {"min": 4e-6}}
    other = times | {"extra_info": times["extra_info"] | {"name": "daqp"}}
    run = {"commit_info": {"id": "abc"}, "datetime": "2026-01-01", "benchmarks": [times, other]}
    (tmp_path / "bench").mkdir()
    (tmp_path / "bench" / "run.json").write_text(json.dumps(run))
    monkeypatch.setattr(numbers, "ROBOTS", tmp_path / "robots")
    monkeypatch.setattr(numbers, "BENCH", tmp_path / "bench")
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "old.json").write_text("{}")
    return tmp_path


def test_a_further_chapter_of_a_study_has_its_own_folder_and_every_result_an_origin(results):
    data = results / "data"
    numbers.main(results / "studies", data)
    assert not (data / "old.json").exists()
    for folder, name in ((data, "recover"), (data / "events", "events")):
        assert json.loads((folder / "recover.json").read_text())["name"] == name
        assert len(pd.read_parquet(folder / "recover.parquet")) == 1
    origins = json.loads((data / "origin.json").read_text())
    assert {name: origin["commit"] for name, origin in origins.items()} == dict.fromkeys(
        ("recover", "events", "robots", "bench"), "abc"
    )
    [ratio] = json.loads((data / "bench.json").read_text())["ratios"]
    assert (ratio["us"], ratio["ratio"]) == (2.0, 1.0)


def test_an_incomplete_report_leaves_the_data_as_they_are(results):
    file = results / "studies" / "report.json"
    file.write_text(file.read_text().replace('"missing": []', '"missing": ["atlas"]'))
    with pytest.raises(SystemExit, match="not complete"):
        numbers.main(results / "studies", results / "data")
    assert (results / "data" / "old.json").exists()
