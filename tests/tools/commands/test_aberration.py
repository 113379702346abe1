"""A lens with lateral chromatic aberration, by the commands: from its simulation to pictures, and measured on edges."""

from pathlib import Path

import numpy as np
import pytest
import tifffile

from shared import read_camera, read_dng
from tests.tools.calibration.known_camera import save, stating
from tests.tools.command import run
from tests.tools.commands.taken import taken
from tools.camera.lens import lens_aberration

SIZE, SHAPE = "450x300", (300, 450)
EDGES_SIZE, EDGES_SHAPE = "600x400", (400, 600)
EDGES_LENS = 1.0, -0.6


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two shots of a lens, one that knows it, and the camera file that they make."""
    folder = tmp_path_factory.mktemp("lens")
    (folder / "shots" / "Edges").mkdir(parents=True)
    options = ("--period", "4", "--sensor-bits", "12", f"--aberration={EDGES_LENS[0]},{EDGES_LENS[1]}")
    taken(folder, "shots/Edges/1.dng", f"chart:{EDGES_SIZE}", *options)
    taken(folder, "shots/edges2.dng", f"chart:{EDGES_SIZE}", *options, "--seed", "1", focal=35.0, aberration=None)
    outcome = run("calibrate", folder / "shots", "-o", folder / "camera.json", "--report", folder, "--json")
    assert outcome.code == 0, outcome.err
    assert [record["kind"] for record in outcome.records[:-1]] == ["edges", "edges"]
    assert "lateral chromatic aberration: R +" in outcome.err
    return folder


@pytest.fixture
def path(folder: Path, tmp_path: Path) -> Path:
    """A copy of the camera file."""
    (tmp_path / "camera.json").write_bytes((folder / "camera.json").read_bytes())
    return tmp_path / "camera.json"


def test_a_shot_states_it_and_render_undoes_it(tmp_path: Path) -> None:
    made = run("simulate", f"chart:{SIZE}", "-o", tmp_path, "--aberration=-1,1", "--truth")
    assert made.code == 0, made.err
    path = tmp_path / f"chart-{SIZE}.dng"
    shot = read_dng(path)
    assert shot.calibration.aberration == lens_aberration(-1, 1, 3, SHAPE)
    assert "aberration    R -1.00, G +0.00, B +1.00 pixels in the corners; undone" in run("inspect", path).out
    unknown = save(tmp_path / "unknown.dng", stating(shot, aberration=None))
    outcome = run("render", path, unknown, "-o", tmp_path / "out", "--bits", "32", "--space", "camera")
    assert outcome.code == 0, outcome.err
    truth = tifffile.imread(tmp_path / f"chart-{SIZE}.truth.tif")
    undone, left = (
        float(np.square(tifffile.imread(tmp_path / "out" / name) - truth).mean()) for name in (f"chart-{SIZE}.tif", "unknown.tif")
    )
    assert undone < 0.6 * left


@pytest.mark.parametrize(
    ("option", "texts"),
    [("--shading", ("9,0", "1,99", "much", "1,2,3", "-1")), ("--aberration", ("", "1", "much,1", "1,2,3", "21,0", "nan,0"))],
)
def test_impossible_lenses_are_usage(option: str, texts: tuple[str, ...], tmp_path: Path) -> None:
    for text in texts:
        outcome = run("simulate", "flat:60x40", "-o", tmp_path, f"{option}={text}")
        assert (outcome.code, option in outcome.err) == (2, True), text


def test_a_lens_that_is_too_strong_for_a_small_frame_is_refused(tmp_path: Path) -> None:
    outcome = run("simulate", "flat:60x40", "-o", tmp_path, "--aberration", "3,0")
    assert outcome.code == 1
    assert "flat:60x40: --aberration is 3,0: the most in a frame of 60 x 40 pixels is 1.8" in outcome.err


def test_edges_make_a_camera_file_that_keeps_it(folder: Path) -> None:
    camera = read_camera(folder / "camera.json")
    assert camera.calibration.aberration is not None
    np.testing.assert_allclose(camera.calibration.aberration.corner(EDGES_SHAPE), [EDGES_LENS[0], 0, EDGES_LENS[1]], atol=0.3)
    facts = camera.measured["aberration"]
    assert (facts["shots"], facts["focal_length"]) == (2, 35)
    np.testing.assert_allclose(facts["corner"], camera.calibration.aberration.corner(EDGES_SHAPE), rtol=1e-2)
    assert 0 < max(facts["standard_error"]) < 0.2
    page = (folder / "report.html").read_text("utf-8")
    assert "<p>Lateral chromatic aberration: R +" in page
    assert 'aria-label="Displacement over radius"' in page


def test_an_update_keeps_it_and_new_edges_replace_it(folder: Path, path: Path) -> None:
    dark = taken(path.parent, "dark.dng", f"dark:{EDGES_SIZE}", "--period", "4")
    assert run("calibrate", "--dark", dark, "-o", path, "--update").code == 0
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
    flat = taken(tmp_path, "flat.dng", "flat:300x200", "--light", "0.5")
    outcome = run("calibrate", "--edges", flat, "-o", tmp_path / "camera.json", "--json")
    assert outcome.code == 1
    assert not (tmp_path / "camera.json").exists()
    assert "it has hardly any edges" in outcome.records[0]["error"]
    assert "no frame could be used, and no camera file was written" in outcome.err


def test_that_a_lens_has_none_is_a_measurement(path: Path) -> None:
    chart = taken(path.parent, "chart.dng", "chart:900x600", "--period", "4")
    outcome = run("calibrate", "--edges", chart, "-o", path, "--update")
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
