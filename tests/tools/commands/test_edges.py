"""Lateral chromatic aberration from shots with edges, by the commands."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from shared import CaptureMetadata, Mosaic, read_camera, read_dng, write_dng
from tests.tools.command import run

SIZE, SHAPE = "600x400", (400, 600)
LENS = 1.0, -0.6


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two shots of a lens, one that knows another one, and the camera file that they make."""
    folder = tmp_path_factory.mktemp("lens")
    (folder / "shots" / "Edges").mkdir(parents=True)
    options = ("--period", "4", "--sensor-bits", "12", "--protocol", "sensor", f"--aberration={LENS[0]},{LENS[1]}")
    assert run("simulate", f"chart:{SIZE}", "-o", folder, *options).code == 0
    shot = read_dng(folder / f"chart-{SIZE}.dng")
    assert run("simulate", f"chart:{SIZE}", "-o", folder / "other", *options, "--seed", "1").code == 0
    other = read_dng(folder / "other" / f"chart-{SIZE}.dng")
    known = replace(other.calibration, aberration=None)
    upright = Mosaic(other.codes, other.pattern, known, CaptureMetadata(focal_length=35.0))
    write_dng(folder / "shots" / "Edges" / "1.dng", shot, np.zeros((20, 30, 3), np.uint8))
    write_dng(folder / "shots" / "edges2.dng", upright, np.zeros((20, 30, 3), np.uint8))
    outcome = run("calibrate", folder / "shots", "-o", folder / "camera.json", "--report", folder, "--json")
    assert outcome.code == 0, outcome.err
    assert [record["kind"] for record in outcome.records[:-1]] == ["edges", "edges"]
    assert "lateral chromatic aberration: R +" in outcome.err
    return folder


def test_edges_make_a_camera_file_that_keeps_it(folder: Path) -> None:
    camera = read_camera(folder / "camera.json")
    assert camera.calibration.aberration is not None
    np.testing.assert_allclose(camera.calibration.aberration.corner(SHAPE), [LENS[0], 0, LENS[1]], atol=0.3)
    facts = camera.measured["aberration"]
    assert (facts["shots"], facts["focal_length"]) == (2, 35)
    np.testing.assert_allclose(facts["corner"], camera.calibration.aberration.corner(SHAPE), rtol=1e-2)
    assert 0 < max(facts["standard_error"]) < 0.2
    page = (folder / "report.html").read_text("utf-8")
    assert "<p>Lateral chromatic aberration: R +" in page
    assert 'aria-label="Displacement over radius"' in page


def test_an_update_keeps_it_and_new_edges_replace_it(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "camera.json"
    path.write_bytes((folder / "camera.json").read_bytes())
    assert run("simulate", f"dark:{SIZE}", "-o", tmp_path, "--protocol", "sensor", "--period", "4").code == 0
    assert run("calibrate", "--dark", tmp_path / f"dark-{SIZE}.dng", "-o", path, "--update").code == 0
    before, after = (read_camera(each) for each in (folder / "camera.json", path))
    assert "black_level" in after.measured
    assert after.calibration.aberration == before.calibration.aberration
    assert after.measured["aberration"] == before.measured["aberration"]
    outcome = run("calibrate", "--edges", folder / "shots" / "Edges" / "1.dng", "-o", path, "--update")
    assert outcome.code == 0
    replaced = read_camera(path)
    assert replaced.measured["aberration"]["shots"] == 1
    assert replaced.calibration.aberration != before.calibration.aberration
    assert replaced.measured["black_level"] == after.measured["black_level"]


def test_shots_that_do_not_tell_it_are_skipped(tmp_path: Path) -> None:
    assert run("simulate", "flat:300x200", "-o", tmp_path, "--protocol", "sensor", "--light", "0.5").code == 0
    outcome = run("calibrate", "--edges", tmp_path, "-o", tmp_path / "camera.json", "--json")
    assert outcome.code == 1
    assert not (tmp_path / "camera.json").exists()
    assert "it has hardly any edges" in outcome.records[0]["error"]
    assert "no frame could be used, and no camera file was written" in outcome.err


def test_that_a_lens_has_none_is_a_measurement(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "camera.json"
    path.write_bytes((folder / "camera.json").read_bytes())
    assert run("simulate", "chart:900x600", "-o", tmp_path, "--period", "4", "--protocol", "sensor").code == 0
    outcome = run("calibrate", "--edges", tmp_path, "-o", path, "--update")
    assert outcome.code == 0, outcome.err
    assert "no lateral chromatic aberration: known to ±0." in outcome.out
    camera = read_camera(path)
    assert camera.calibration.aberration is None
    assert "corner" not in camera.measured["aberration"]


def test_a_copy_of_a_shot_tells_nothing_more(folder: Path, tmp_path: Path) -> None:
    path = folder / "shots" / "edges2.dng"
    (tmp_path / "copy.dng").write_bytes(path.read_bytes())
    outcome = run("calibrate", "--edges", path, path, tmp_path / "copy.dng", "-o", tmp_path / "camera.json")
    assert outcome.code == 1
    assert f"copy.dng: it is the same shot as {path}" in outcome.err
    assert read_camera(tmp_path / "camera.json").measured["aberration"]["shots"] == 1
