"""A lens with shading, from its simulation to pictures, by the commands."""

import json
from pathlib import Path

import numpy as np
import pytest
import tifffile

from shared import read_camera, read_dng
from tests.tools.calibration.known_camera import edited, save, stating
from tests.tools.command import run
from tests.tools.commands.taken import taken
from tools.camera.lens import lens_shading

SIZE, SHAPE = "450x300", (300, 450)
LENS = lens_shading(1.5, 0.1, 4, SHAPE)


def photographed(folder: Path, scene: str, name: str, *options: str, focal: float | None = 35.0) -> None:
    """A shot of a camera that does not know the shading of its lens."""
    taken(folder, name, f"{scene}:{SIZE}", "--shading", "1.5,10", *options, focal=focal, shading=None)
    assert read_dng(folder / "true" / f"{scene}-{SIZE}.dng").calibration.shading == LENS


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Flat frames, a shot, and the camera file that the flat frames make."""
    folder = tmp_path_factory.mktemp("lens")
    for light in ("0.2", "0.6"):
        for seed in ("1", "2"):
            photographed(folder, "flat", f"flat{light}-{seed}.dng", "--light", light, "--seed", seed)
    photographed(folder, "builtin", "shot.dng", "--sensor-bits", "12", "--light", "0.9", focal=50.0)
    outcome = run("calibrate", "--flat", *folder.glob("flat*.dng"), "-o", folder / "camera.json", "--report", folder)
    assert outcome.code == 0, outcome.err
    assert "shading: 1.4" in outcome.out
    assert "bottom right" in (folder / "report.html").read_text("utf-8")
    return folder


@pytest.fixture
def path(folder: Path, tmp_path: Path) -> Path:
    """A copy of the camera file."""
    (tmp_path / "camera.json").write_bytes((folder / "camera.json").read_bytes())
    return tmp_path / "camera.json"


def test_flat_frames_make_a_camera_file_that_keeps_it(folder: Path) -> None:
    camera = read_camera(folder / "camera.json")
    assert camera.calibration.shading is not None
    np.testing.assert_allclose(camera.calibration.shading.of_plane(SHAPE, 0), LENS.of_plane(SHAPE, 0), rtol=0.02)
    facts = camera.measured["shading"]
    assert (facts["frames"], facts["focal_length"]) == (4, 35)
    assert "% between colours at 35 mm; undone" in run("inspect", folder / "camera.json").out


def test_commands_undo_it_and_tell_another_focal_length(folder: Path, path: Path, tmp_path: Path) -> None:
    told = "shot.dng: taken at 50 mm, but its shading was measured at 35 mm"
    camera = "--camera", path
    outcome = run("render", folder / "shot.dng", "-o", tmp_path, "--bits", "32", "--space", "camera", *camera)
    assert outcome.code == 0, outcome.err
    assert told in outcome.err
    known = run("render", folder / "true" / f"builtin-{SIZE}.dng", "-o", tmp_path, "--bits", "32", "--space", "camera")
    assert "focal" not in known.err
    assert " mm" not in known.err
    measured, true = (tifffile.imread(tmp_path / name) for name in ("shot.tif", f"builtin-{SIZE}.tif"))
    assert float(np.median(np.abs(measured - true))) < 0.003
    outcome = run("preview", folder / "shot.dng", "-o", tmp_path, *camera)
    assert outcome.code == 0
    assert told in outcome.err
    assert told in run("calibrate", "--no-chart", folder / "shot.dng", "-o", path, "--update").err


def test_refused_flat_frames_leave_what_is_known_of_noise(folder: Path, path: Path, tmp_path: Path) -> None:
    """Light that is tilted: shading is not measured, and the reason is told; nor is what the shots say of it taken over.

    What a camera file knows of it stays.
    """
    slope = np.linspace(0.9, 1.1, SHAPE[1])
    for flat_path in folder.glob("flat*.dng"):
        flat = read_dng(flat_path)
        save(tmp_path / flat_path.name, stating(edited(flat, lambda codes: (codes - 256) * slope + 256), shading=LENS))
    tilted, new = sorted(tmp_path.glob("flat*.dng")), tmp_path / "new.json"
    reason = "flat frames: the light is tilted"
    outcome = run("calibrate", "--flat", *tilted, "-o", new, "--json")
    assert outcome.code == 0
    assert f"no shading was measured: {reason}" in outcome.err
    assert outcome.records[-1]["verdict"] == "use it with care"
    assert "shading" not in json.loads(new.read_text())
    refused = run("calibrate", "--flat", tilted[0], "-o", tmp_path / "none.json")  # tells no noise either, and both are told
    assert refused.code == 1
    assert "no two unclipped frames have the same exposure" in refused.err
    assert f"no shading was measured: {reason}" in refused.err
    kept = run("calibrate", "--flat", *tilted, "-o", path, "--update")
    assert f"no shading was measured, and the one before is kept: {reason}" in kept.err
    assert read_camera(path).calibration.shading == read_camera(folder / "camera.json").calibration.shading


def test_one_flat_frame_tells_shading_and_no_noise(folder: Path, tmp_path: Path) -> None:
    outcome = run("calibrate", "--flat", next(folder.glob("flat0.6*.dng")), "-o", tmp_path / "camera.json")
    assert outcome.code == 0, outcome.err
    assert "no noise was measured: flat frames: no two unclipped frames" in outcome.err
    assert list(read_camera(tmp_path / "camera.json").measured) == ["shading"]


def test_even_frames_replace_a_shading(folder: Path, path: Path) -> None:
    flat = taken(path.parent, "flat.dng", f"flat:{SIZE}", "--light", "0.6")
    outcome = run("calibrate", "--flat", flat, "-o", path, "--update")
    assert outcome.code == 0, outcome.err
    assert "no shading: 1 flat frame, even to" in outcome.out
    camera, shot = read_camera(path), read_dng(folder / "true" / f"builtin-{SIZE}.dng")
    assert camera.calibration.shading is None
    assert camera.measured["shading"]["frames"] == 1
    assert shot.calibration.shading is not None
    assert camera.calibrated(shot).calibration.shading is None  # what is measured counts more than what the shot says


def test_a_lens_is_simulated_once_and_not_beside_that_of_a_camera_file(folder: Path, tmp_path: Path) -> None:
    assert run("simulate", "flat:60x40", "-o", tmp_path, "--shading", "0,0").code == 0
    assert run("simulate", "flat:6x6", "-o", tmp_path, "--shading", "2,15").code == 0
    assert [read_dng(tmp_path / f"flat-{size}.dng").calibration.shading is None for size in ("60x40", "6x6")] == [True, False]
    camera = "--camera", folder / "camera.json"
    two = run("simulate", "flat:60x40", "-o", tmp_path, "--shading", "1,5", *camera)
    assert (two.code, "has its own shading" in two.err) == (2, True)
    assert run("simulate", "flat:60x40", "-o", tmp_path, "--overwrite", *camera).code == 0  # the camera's own
    assert read_dng(tmp_path / "flat-60x40.dng").calibration.shading is not None
