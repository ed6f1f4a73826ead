"""Recordings read back: entities, rows, values to the bit."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

ENTITIES = {
    "/pointing/desired": ("desired_rad", 1e6),
    "/pointing/true": ("true_rad", 1e6),
    "/pointing/measured": ("measured_rad", 1e6),
    "/strut/input": ("strut_input_percent", 1.0),
    "/strut/displacement": ("strut_displacement_m", 1e6),
    "/secondary/true": ("secondary", 1e6),
    "/secondary/estimated": ("secondary_estimated", 1e6),
}


def scalars(path: Path, entity: str) -> tuple[np.ndarray, np.ndarray]:
    """Times [ns] and values of an entity's rows."""
    stream = RrdReader(path).stream()
    chunks = stream.filter(
        content=entity, components="Scalars:scalars", is_static=False
    ).to_chunks()
    batches = [chunk.to_record_batch() for chunk in chunks]
    values = [batch.column("Scalars:scalars").to_pylist() for batch in batches]
    times = [batch.column("sim_time").cast("int64").to_numpy() for batch in batches]
    return np.concatenate(times), np.concatenate(values)


@pytest.mark.parametrize("entity", ENTITIES)
def test_a_recording_holds_the_run_at_250_hz_to_the_bit(table1_folder, runs, entity):
    field, factor = ENTITIES[entity]
    times, values = scalars(table1_folder / "W_e.rrd", entity)
    run = runs["W_e"]
    np.testing.assert_array_equal(values, factor * run[field][::4])
    np.testing.assert_array_equal(times, np.arange(4000) * 4_000_000)


def test_every_column_has_a_small_recording_with_a_screen_and_its_story(table1, table1_folder):
    for column in table1["columns"]:
        path = table1_folder / column["recording"]
        assert path.stat().st_size < 8e6
        reader = RrdReader(path)
        assert reader.recordings()[0].application_id == "fjh"
        assert len(reader.blueprints()) == 1
        paths = reader.store().schema().entity_paths(include_properties=True)
        assert {"/notes", "/detector/desired", "/detector/measured", "/detector/spot"} <= set(paths)
        assert any("run" in name for name in paths if "properties" in name)


def test_the_viewers_own_check_finds_the_files_whole(table1_folder):
    rerun = shutil.which("rerun", path=str(Path(sys.executable).parent))
    files = sorted(str(path) for path in table1_folder.glob("*.rrd"))
    assert len(files) == 6
    done = subprocess.run([str(rerun), "rrd", "verify", *files], capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
