"""A lens with shading, by the commands: it is simulated, measured, and undone in pictures."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from panchroma.shared import CaptureMetadata, read_camera, read_dng
from panchroma.tools.simulation.lens import lens_shading
from tests.tools.calibration.known_camera import edited, save, stating
from tests.tools.command import repeated, run

SIZE, SHAPE = "450x300", (300, 450)
LENS = lens_shading(1.5, 0.1, 4, SHAPE)


def taken(
    folder: Path, name: str, source: str, *options: str, focal: float | None = None, **facts: Any
) -> Path:
    """Simulate a source in `folder/true`, and save the shot as `folder/name`, where its calibration
    states other facts.
    """
    run("simulate", source, "--overwrite --light 1 -o", folder / "true", *options, code=0)
    shot = read_dng(folder / "true" / f"{source.replace(':', '-')}.dng")
    metadata = CaptureMetadata(focal_length=focal)
    return save(folder / name, replace(stating(shot, **facts), metadata=metadata))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Flat frames, a shot, and the camera file that the flat frames make."""
    folder = tmp_path_factory.mktemp("lens")
    lens = "--shading 1.5,10 --light"
    for number in range(4):
        options = f"{lens} {(0.2, 0.6)[number // 2]} --seed {number}"
        taken(folder, f"flat{number}.dng", f"flat:{SIZE}", options, focal=35.0, shading=None)
    taken(folder, "shot.dng", f"builtin:{SIZE}", f"{lens} 0.9", focal=50.0, shading=None)
    assert read_dng(folder / "true" / f"builtin-{SIZE}.dng").calibration.shading == LENS
    flats = repeated("--flat", folder.glob("flat*.dng"))
    outcome = run("calibrate --report", folder, *flats, "-o", folder / "camera.json", code=0)
    assert "shading: 1.4" in outcome.out
    return folder


@pytest.fixture
def path(folder: Path, tmp_path: Path) -> Path:
    """A copy of the camera file."""
    (tmp_path / "camera.json").write_bytes((folder / "camera.json").read_bytes())
    return tmp_path / "camera.json"


def test_flat_frames_make_a_camera_file_that_keeps_it(folder: Path) -> None:
    camera = read_camera(folder / "camera.json")
    measured = camera.calibration.shading.of_plane(SHAPE, 0)
    np.testing.assert_allclose(measured, LENS.of_plane(SHAPE, 0), rtol=0.02)
    facts = camera.measured["shading"]
    assert (facts["frames"], facts["focal_length"]) == (4, 35)
    assert "bottom right" in (folder / "report.html").read_text("utf-8")
    assert "% between colours at 35 mm; undone" in run("inspect", folder / "camera.json").out


def test_commands_tell_another_focal_length(folder: Path, path: Path, tmp_path: Path) -> None:
    told = "shot.dng: taken at 50 mm, but its shading was measured at 35 mm"
    for command in ("render -f npy --preset paper -o", "preview -o"):
        assert told in run(command, tmp_path, folder / "shot.dng", "--camera", path, code=0).err
    assert told in run("calibrate", folder / "shot.dng", "-o", path, "--update").err


def test_refused_flats_leave_what_is_known(folder: Path, path: Path, tmp_path: Path) -> None:
    """Light that is tilted: shading is not measured, and the reason is told; nor is what the shots
    say of it taken over.

    What a camera file knows of it stays.
    """
    slope = np.linspace(0.9, 1.1, SHAPE[1])
    for flat_path in folder.glob("flat*.dng"):
        flat = edited(read_dng(flat_path), lambda codes: (codes - 256) * slope + 256)
        save(tmp_path / flat_path.name, stating(flat, shading=LENS))
    tilted, new = repeated("--flat", tmp_path.glob("flat*.dng")), tmp_path / "new.json"
    reason = "flat frames: the light is tilted"
    outcome = run("calibrate", *tilted, "-o", new, "--json", code=0)
    assert f"no shading was measured: {reason}" in outcome.err
    assert outcome.records[-1]["verdict"] == "use it with care"
    assert "shading" not in json.loads(new.read_text())
    kept = run("calibrate", *tilted, "-o", path, "--update")
    assert f"no shading was measured, and the one before is kept: {reason}" in kept.err
    before = read_camera(folder / "camera.json").calibration
    assert read_camera(path).calibration.shading == before.shading


def test_one_flat_frame_tells_shading_and_no_noise(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "camera.json"
    outcome = run("calibrate --flat", folder / "flat3.dng", "-o", path, code=0)
    assert "no noise was measured: flat frames: no two unclipped frames" in outcome.err
    assert list(read_camera(path).measured) == ["shading"]


def test_a_lens_is_simulated_once_and_not_beside_a_camera_s(folder: Path, tmp_path: Path) -> None:
    run("simulate", "flat:60x40", "-o", tmp_path, "--shading", "0,0", code=0)
    assert read_dng(tmp_path / "flat-60x40.dng").calibration.shading is None
    camera = "--camera", folder / "camera.json", "--overwrite"
    two = run("simulate", "flat:60x40", "-o", tmp_path, "--shading", "1,5", *camera)
    assert (two.code, "has its own shading" in two.err) == (2, True)
    run("simulate", "flat:60x40", "-o", tmp_path, *camera, code=0)  # the camera's own
    assert read_dng(tmp_path / "flat-60x40.dng").calibration.shading is not None
