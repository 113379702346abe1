"""A lens with lateral chromatic aberration, by the commands: simulated, and measured on edges."""

from pathlib import Path

import numpy as np
import pytest

from shared import read_camera, read_dng
from tests.tools.command import run
from tests.tools.commands.taken import taken
from tools.camera.lens import lens_aberration

SIZE, SHAPE = "600x400", (400, 600)
LENS = 1.0, -0.6


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two shots of a lens, one that knows it, and the camera file that they make."""
    folder = tmp_path_factory.mktemp("lens")
    (folder / "shots" / "Edges").mkdir(parents=True)
    options = ("--period", "4", "--sensor-bits", "12", f"--aberration={LENS[0]},{LENS[1]}")
    taken(folder, "shots/Edges/1.dng", f"chart:{SIZE}", *options)
    taken(folder, "shots/edges2.dng", f"chart:{SIZE}", *options, "--seed", "1", focal=35.0, aberration=None)
    outcome = run("calibrate", folder / "shots", "-o", folder / "camera.json", "--report", folder, "--json", code=0)
    assert [record["kind"] for record in outcome.records[:-1]] == ["edges", "edges"]
    assert "lateral chromatic aberration: R +" in outcome.err
    return folder


def test_a_simulated_shot_states_it(folder: Path) -> None:
    path = folder / "true" / f"chart-{SIZE}.dng"
    assert read_dng(path).calibration.aberration == lens_aberration(*LENS, 3, SHAPE)
    assert "aberration    R +1.00, G +0.00, B -0.60 pixels in the corners; undone" in run("inspect", path).out


def test_edges_make_a_camera_file_that_keeps_it(folder: Path) -> None:
    camera = read_camera(folder / "camera.json")
    np.testing.assert_allclose(camera.calibration.aberration.corner(SHAPE), [LENS[0], 0, LENS[1]], atol=0.3)
    facts = camera.measured["aberration"]
    assert (facts["shots"], facts["focal_length"]) == (2, 35)
    np.testing.assert_allclose(facts["corner"], camera.calibration.aberration.corner(SHAPE), rtol=1e-2)
    assert 0 < max(facts["standard_error"]) < 0.2
    page = (folder / "report.html").read_text("utf-8")
    assert "<p>Lateral chromatic aberration: R +" in page
    assert 'aria-label="Displacement over radius"' in page


def test_a_copy_of_a_shot_tells_nothing_more_and_a_shot_without_edges_nothing(folder: Path, tmp_path: Path) -> None:
    path, copy, output = folder / "shots" / "edges2.dng", tmp_path / "copy.dng", tmp_path / "camera.json"
    copy.write_bytes(path.read_bytes())
    outcome = run("calibrate", "--edges", path, path, copy, "-o", output, code=1)
    assert f"copy.dng: it is the same shot as {path}" in outcome.err
    known = read_camera(output)
    assert known.measured["aberration"]["shots"] == 1
    flat = taken(tmp_path, "flat.dng", f"flat:{SIZE}", "--period", "4", "--light", "0.5")
    outcome = run("calibrate", "--edges", flat, "-o", output, "--update", "--json", code=1)
    assert "it has hardly any edges" in outcome.records[0]["error"]
    assert "no frame could be used, and no camera file was written" in outcome.err
    assert "no chromatic aberration was measured, and the one before is kept" in outcome.err
    assert read_camera(output) == known
