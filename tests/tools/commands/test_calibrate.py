"""The verb: files in, camera.json and report out."""

import re
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from shared import Camera, CfaPattern, Mosaic, NoiseModel, SensorCalibration, read_camera, read_dng
from shared.errors import InputError
from shared.sensor import simulate_sensor, typical_noise
from tests.tools.calibration.known_camera import BLIND, NOISE, TRUTH, chart, frame, save, true_place, with_code
from tests.tools.command import run
from tools.calibration.camera_file import difference, write_camera
from tools.calibration.reference import read_reference, ti3
from tools.calibration.shot import measure_chart
from tools.commands.calibrate import color_checker_xyz

pytest.importorskip("cv2")
CORNERS = [f"{x:.1f},{y:.1f}" for x, y in true_place().corners]
CMY = CfaPattern.of_letters("WYWC/YWCW/WCWM/CWMW", (0, 1), "CMY")
BROAD = (1 - np.eye(3)) / 2  # what cyan, magenta and yellow see of red, green and blue


def noise_of(camera: Camera) -> NoiseModel:
    assert camera.calibration.noise is not None
    return camera.calibration.noise


STEPS: dict[str, list[str]] = {
    "chart": ["chart.dng", "--corners", *CORNERS],
    "dark": ["--dark", "dark0.dng", "dark1.dng"],
    "flat": ["--flat", *(f"flat{light}{number}.dng" for light in (1, 5, 8) for number in range(2))],
}


def calibrated(folder: Path, output: Path, *steps: str) -> dict[str, Any]:
    """The last record of `calibrate --update` with the frames of these steps."""
    words = [word if word.startswith("-") or "," in word else str(folder / word) for step in steps for word in STEPS[step]]
    outcome = run("calibrate", *words, "-o", output, "--update", "--json")
    assert outcome.code == 0, outcome.err
    return outcome.records[-1]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A chart, dark frames and flat frames."""
    folder = tmp_path_factory.mktemp("bench")
    save(folder / "chart.dng", frame(chart().rgb))
    for number in range(2):
        save(folder / f"dark{number}.dng", frame(np.zeros((*chart().shape, 3)), seed=number))
        for light in (1, 5, 8):
            flat = frame(np.full((*chart().shape, 3), light / 10), seed=10 * light + number)
            save(folder / f"flat{light}{number}.dng", flat)
    return folder


def test_a_folder_becomes_a_camera(folder: Path, tmp_path: Path) -> None:
    output = tmp_path / "camera.json"
    outcome = run("calibrate", folder, "-o", output, "--report", tmp_path, "--json")
    assert outcome.code == 0, outcome.err
    camera = read_camera(output)
    np.testing.assert_allclose(camera.calibration.gamma, TRUTH.gamma, rtol=0.01)
    np.testing.assert_allclose(camera.calibration.black_level, TRUTH.black_level, atol=0.1)
    np.testing.assert_allclose(noise_of(camera).shot, NOISE.shot, rtol=0.06)
    assert set(camera.measured) == {"gamma", "noise", "black_level", "defects", "colour", "shading"}
    assert camera.calibration.shading is None  # the flat frames are even
    assert camera.pattern == read_dng(folder / "chart.dng").pattern
    assert [record["ok"] for record in outcome.records] == [True] * 10
    assert outcome.records[-1]["id"] == camera.calibration.id

    page = (tmp_path / "report.html").read_text("utf-8")
    assert "Use it" in page
    assert page.count("<svg") == 3
    assert page.count('class="patch"') == 24
    assert "prefers-color-scheme: dark" in page
    assert not re.search(r'(?:src|href)="(?!data:)', page), "the page loads something"
    np.testing.assert_allclose(read_reference(tmp_path / "chart.ti3"), color_checker_xyz(), atol=1e-6)

    # Refuses to overwrite, and simulates and renders with what was measured.
    assert run("calibrate", folder, "-o", output).code == 2
    assert run("simulate", "chart:120x80", "-o", tmp_path, "--camera", output, "--protocol", "sensor").code == 0
    assert read_dng(tmp_path / "chart-120x80.dng").calibration.camera == camera.calibration.id
    assert run("render", tmp_path / "chart-120x80.dng", "-o", tmp_path, "--camera", output).code == 0
    other = run("simulate", "chart:120x80", "-o", tmp_path, "--camera", output, "--period", "8", "--overwrite")
    assert (other.code, "period 8" in other.err) == (2, True)
    shown = run("inspect", output).out
    assert camera.calibration.id in shown
    assert "half_width_95" in shown


def test_an_update_replaces_what_was_measured_and_keeps_the_old_file(folder: Path, tmp_path: Path) -> None:
    output = tmp_path / "camera.json"
    calibrated(folder, output, "chart")
    before, text = read_camera(output), output.read_text()
    outcome = run("calibrate", "--dark", folder / "dark0.dng", folder / "dark1.dng", "-o", output, "--update")
    assert outcome.code == 0, outcome.err
    after = read_camera(output)
    replaced = {part: getattr(after.calibration, part) for part in ("black_level", "defects")}
    assert after.calibration == replace(before.calibration, **replaced, camera=after.calibration.id)
    assert {part: how for part, how in after.measured.items() if part not in replaced} == before.measured
    assert (tmp_path / "camera.json.bak").read_text() == text
    assert "black_level: [256, 257, 255, 258] -> " in outcome.out
    assert "measured now: black_level, defects; kept as it was: gamma, noise, colour" in outcome.out
    assert sorted(path.name for path in tmp_path.iterdir()) == ["camera.json", "camera.json.bak"]


def test_bad_shots_are_skipped_with_a_line_and_nothing_is_written_without_a_good_one(folder: Path, tmp_path: Path) -> None:
    grey, output = save(tmp_path / "grey.dng", frame(np.full((60, 90, 3), 0.2))), tmp_path / "camera.json"
    outcome = run("calibrate", grey, tmp_path / "absent.dng", "-o", output)
    assert (outcome.code, output.exists()) == (1, False)
    assert re.search(r"no ColorChecker was found.*give its corners: --corners x,y x,y x,y x,y", outcome.err)
    assert "absent.dng" in outcome.err
    other = save(tmp_path / "other.dng", frame(chart().rgb, 8))
    outcome = run("calibrate", folder / "chart.dng", other, "-o", output)
    assert (outcome.code, "period 8" in outcome.err) == (1, True)
    assert read_camera(output).calibration.gamma == pytest.approx(TRUTH.gamma, rel=0.02)


def test_what_cannot_work_is_refused_before_the_work(folder: Path, tmp_path: Path) -> None:
    shot, output = folder / "chart.dng", tmp_path / "camera.json"
    commands: tuple[tuple[list[str | Path], str], ...] = (
        (["-o", output], "nothing to calibrate from"),
        ([shot, "-o", tmp_path], "is a folder"),
        ([shot, "-o", tmp_path / "no" / "camera.json"], "does not exist"),
        ([shot, shot, "--corners", *CORNERS, "-o", output], "one shot"),
        ([shot, "--corners", "1", "2", "3", "4", "-o", output], "is not 2 numbers with commas between them"),
        ([shot, "-o", shot, "--overwrite"], "is an input"),
    )
    for words, why in commands:
        outcome = run("calibrate", *words)
        assert (outcome.code, why in outcome.err) == (2, True), why


def camera(measured: tuple[str, ...], **changes: Any) -> Camera:
    pattern = frame(np.zeros((12, 12, 3))).pattern
    return Camera(replace(BLIND, **changes), pattern, {part: {"date": "2026-01-01"} for part in measured})


def test_the_difference_is_in_figures_that_look_different() -> None:
    old = camera(("noise",), noise=TRUTH.noise)
    new, alike = (
        replace(old, calibration=replace(old.calibration, gamma=gamma)) for gamma in ((2.0, 2.0, 2.0), (1 + 1e-9, 1.0, 1.0))
    )
    assert difference(old, new) == ["gamma: [1, 1, 1] -> [2, 2, 2]"]
    assert not difference(old, alike)


def test_another_sensor_is_not_updated(tmp_path: Path) -> None:
    path = tmp_path / "camera.json"
    write_camera(path, camera(("gamma",)))
    text = path.read_text()
    for says, words in (
        (replace(BLIND, sensor="other"), r"camera.json: .*'other'.*'bench'"),
        (replace(BLIND, white_level=4000), "white level 4000, the camera file 4095"),
    ):
        other = save(tmp_path / "other.dng", frame(np.zeros((60, 90, 3)), says=says))
        outcome = run("calibrate", "--dark", other, "-o", path, "--update")
        assert outcome.code == 2
        assert re.search(words, outcome.err)
        assert path.read_text() == text
        other.unlink()


def test_the_noise_of_flat_frames_is_not_replaced_by_that_of_a_chart(folder: Path, tmp_path: Path) -> None:
    """It is in scene units, which a new gamma rescales."""
    path = tmp_path / "camera.json"
    calibrated(folder, path, "flat")
    old = read_camera(path)
    calibrated(folder, path, "chart")
    new = read_camera(path)
    assert new.measured["noise"] == old.measured["noise"]
    ratio = new.calibration.full_scale / old.calibration.full_scale
    assert abs(ratio - 1) > 0.05
    for name in ("shot", "read"):
        np.testing.assert_allclose(getattr(noise_of(new), name), ratio * np.array(getattr(noise_of(old), name)))
    np.testing.assert_allclose(noise_of(new).shot, NOISE.shot, rtol=0.06)
    whole = calibrated(folder, path, "chart", "flat", "dark")  # flat frames replace it
    assert whole["camera"]["measured"]["noise"]["shot_error"] != list(old.measured["noise"]["shot_error"])


def test_parts_that_a_wrong_black_level_made_wrong_are_named(folder: Path, tmp_path: Path) -> None:
    """The shots state a black level that is 5 to 8 codes off: of the same frames in one command the camera is as it should be."""
    loose = replace(BLIND, black_level=(250.0,) * 4)
    for name in (word for words in STEPS.values() for word in words if word.endswith(".dng")):
        save(tmp_path / name, Mosaic(read_dng(folder / name).codes, CfaPattern.bayer(), loose))
    path = tmp_path / "camera.json"
    calibrated(tmp_path, path, "chart")
    wrong = calibrated(tmp_path, path, "dark")
    assert wrong["verdict"] == "use it with care"
    (warning,) = wrong["warnings"]
    assert re.match(r"the black level is [78]\.\d codes off the one with which gamma, noise, colour", warning)
    whole = calibrated(tmp_path, path, *STEPS)
    assert (whole["verdict"], whole["warnings"]) == ("use it", [])
    again = calibrated(tmp_path, path, "dark")
    assert (again["verdict"], again["camera"]["gamma"]) == ("use it", whole["camera"]["gamma"])


def test_hot_pixels_stay_when_only_flat_frames_are_new(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "camera.json"
    save(tmp_path / "hot.dng", with_code(read_dng(folder / "dark0.dng"), (50, 70), 1200))
    assert run("calibrate", "--dark", tmp_path / "hot.dng", "-o", path).code == 0
    assert (50, 70) in read_camera(path).calibration.defects
    calibrated(folder, path, "flat")
    assert (50, 70) in read_camera(path).calibration.defects
    calibrated(folder, path, "flat", "dark")  # both kinds list all there are
    assert (50, 70) not in read_camera(path).calibration.defects


@pytest.mark.parametrize("options", [[], ["--period", "4", "--sensor-bits", "16"]])
def test_the_built_in_scenes_make_a_camera_to_use(options: list[str], tmp_path: Path) -> None:
    """As the README tells a newcomer who has no camera."""
    frames: dict[str, list[Path]] = {"chart": [], "dark": [], "flat": []}
    for kind, light, seed in (("chart", 1, 0), *product(["dark"], [1], (1, 2, 3, 4)), *product(["flat"], (0.1, 0.3, 0.6), (1, 2))):
        to = tmp_path / f"{kind}{light}-{seed}"
        lit = [] if light == 1 else ["--light", str(light)]
        outcome = run("simulate", f"{kind}:720x480", "-o", to, "--protocol", "sensor", "--seed", str(seed), *options, *lit)
        assert outcome.code == 0, outcome.err
        frames[kind] += to.iterdir()
    output = tmp_path / "camera.json"
    outcome = run("calibrate", *frames["chart"], "--dark", *frames["dark"], "--flat", *frames["flat"], "-o", output, "--json")
    assert (outcome.code, outcome.records[-1]["warnings"]) == (0, [])
    assert outcome.records[-1]["verdict"] == "use it"
    camera = read_camera(output)
    np.testing.assert_allclose(camera.calibration.gamma, (1, 1, 1), rtol=0.01)
    found, typical = noise_of(camera), typical_noise(camera.calibration)
    np.testing.assert_allclose((found.shot, found.read), (typical.shot, typical.read), rtol=0.05)


def test_the_read_noise_of_dark_frames_reaches_the_noise_of_a_chart(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "camera.json"
    first, second = calibrated(folder, path, "chart"), calibrated(folder, path, "chart", "dark")
    assert any("read noise" in warning and "(--dark)" in warning for warning in first["warnings"])
    np.testing.assert_allclose(second["camera"]["noise"]["read"], NOISE.read, rtol=0.05)
    assert [warning for warning in first["warnings"] if "read noise" not in warning] == second["warnings"]
    assert second["verdict"] == "use it with care"  # the chart's texture is still in the noise


def test_no_gamma_is_stated_that_was_not_measured(folder: Path, tmp_path: Path) -> None:
    """The only chart is of another period, and is skipped: then there is no camera. Without a chart the verdict says so."""
    other, output = save(tmp_path / "other.dng", frame(chart().rgb, 8)), tmp_path / "camera.json"
    darks = ["--dark", str(folder / "dark0.dng"), str(folder / "dark1.dng")]
    outcome = run("calibrate", other, *darks, "-o", output, "--json")
    assert outcome.code == 1
    assert "gamma is not known, for no chart could be used, and no camera file was written" in outcome.err
    assert not outcome.records[-1]["ok"]
    assert not output.exists()
    outcome = run("calibrate", *darks, "-o", output, "--json")
    assert outcome.code == 0
    assert outcome.records[-1]["verdict"] == "use it with care"
    assert any("gamma was not measured" in warning for warning in outcome.records[-1]["warnings"])
    # A gamma that is known already stays, whatever becomes of further charts.
    assert run("calibrate", folder / "chart.dng", "--corners", *CORNERS, "-o", output, "--update").code == 0
    known = read_camera(output).calibration.gamma
    assert run("calibrate", other, *darks, "-o", output, "--update").code == 1
    assert read_camera(output).calibration.gamma == known


@pytest.mark.parametrize("kind", ["dark", "flat"])
def test_a_frame_and_its_copy_measure_nothing(kind: str, folder: Path, tmp_path: Path) -> None:
    name, output = "dark0.dng" if kind == "dark" else "flat50.dng", tmp_path / "camera.json"
    copy = save(tmp_path / "copy.dng", read_dng(folder / name))
    outcome = run("calibrate", f"--{kind}", folder / name, copy, "-o", output)
    assert (outcome.code, output.exists()) == (1, False)
    assert re.search("copy.dng and .* have the same noise", outcome.err)


def seen(rgb: ArrayLike, pattern: CfaPattern, seed: int = 0) -> Mosaic:
    """What the true sensor with this pattern of RGB or CMY filters records of light (H, W, 3), and says of itself."""
    true, says = (replace(each, channels=pattern.channels) for each in (TRUTH, BLIND))
    light = np.asarray(rgb, np.float32) if pattern.channels == "RGB" else (np.asarray(rgb) @ BROAD).astype(np.float32)
    return replace(simulate_sensor(light, pattern, true, 1.0, np.random.default_rng(seed)), calibration=says)


@pytest.mark.parametrize(
    ("right", "wrong", "names"),
    [
        (CfaPattern.bayer(6, "BGGR"), CfaPattern.bayer(6, "RGGB"), "red and blue"),
        (CfaPattern.bayer(6, "GRBG"), CfaPattern.bayer(6, "GBRG"), "red and blue"),
        (CfaPattern.bayer(6, "RGGB"), CfaPattern.bayer(6, "BGGR"), "red and blue"),
        (CMY, CfaPattern.of_letters("WMWC/MWCW/WCWY/CWYW", (0, 1), "CMY"), "magenta and yellow"),
    ],
)
def test_channels_that_are_exchanged_show_on_the_chart(right: CfaPattern, wrong: CfaPattern, names: str) -> None:
    shot = replace(seen(chart().rgb, right), pattern=wrong)
    with pytest.raises(InputError, match=f"the chart shows that {names} are exchanged.*{'/'.join(right.letters_from())}"):
        measure_chart("chart.dng", shot, color_checker_xyz(), true_place().corners)


def test_a_scattered_tile_of_cyan_magenta_and_yellow_from_end_to_end(tmp_path: Path) -> None:
    save(tmp_path / "chart.dng", seen(chart().rgb, CMY))
    for number, (name, level) in enumerate((*(("dark", 0.0),) * 2, *(("flat", 0.1),) * 2, *(("flat", 0.8),) * 2)):
        save(tmp_path / f"{name}{number}.dng", seen(np.full((*chart().shape, 3), level), CMY, number + 1))
    outcome = run("calibrate", tmp_path, "-o", tmp_path / "camera.json", "--report", tmp_path)
    assert outcome.code == 0, outcome.err
    measured = read_camera(tmp_path / "camera.json")
    np.testing.assert_allclose(measured.calibration.gamma, TRUTH.gamma, rtol=0.01)
    np.testing.assert_allclose(noise_of(measured).shot, NOISE.shot, rtol=0.1)
    assert measured.pattern == CMY


@pytest.mark.parametrize("errors", [7, ["x"] * 4, [True] * 4, [1.0] * 3])
def test_a_damaged_camera_file_is_not_updated(errors: Any, folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "camera.json"
    write_camera(path, replace(camera(()), measured={"black_level": {"standard_error": errors}}))
    outcome = run("calibrate", "--dark", folder / "dark0.dng", "-o", path, "--update")
    assert outcome.code == 2
    assert "camera.json: measured.black_level.standard_error " in outcome.err


def test_the_file_has_a_line_per_figure_and_reads_back_the_same(tmp_path: Path) -> None:
    path = tmp_path / "camera.json"
    known = camera(("gamma",), camera_to_xyz=((1.0, 0.1, 0.2), (0.3, 1.0, 0.1), (0.1, 0.2, 1.0)), defects=((1, 2), (3, 4)))
    write_camera(path, known)
    assert read_camera(path) == known
    lines = path.read_text().splitlines()
    assert "    [0.3, 1.0, 0.1]," in lines
    assert '  "sensor": "bench",' in lines


def test_references_by_name_by_number_and_in_lab(tmp_path: Path) -> None:
    reference = color_checker_xyz()
    path = tmp_path / "chart.cie"
    text = ti3(reference, np.full((24, 3), 0.5))
    rows = text.split("BEGIN_DATA\n")[1].split("\nEND_DATA")[0].splitlines()
    path.write_text(text.replace("\n".join(rows), "\n".join(reversed(rows))))
    np.testing.assert_allclose(read_reference(path), reference, atol=1e-6)
    path.write_text(text.replace("XYZ_X XYZ_Y XYZ_Z", "LAB_L LAB_A LAB_B"))
    assert read_reference(path).shape == (24, 3)
    for wrong, words in (("CTI3", "not a CGATS"), (text.replace("A1 ", "A2 "), "once"), (text.replace("XYZ_", "ABC_"), "neither")):
        path.write_text(wrong)
        with pytest.raises(InputError, match=words):
            read_reference(path)


def test_ti3_keeps_device_values_in_the_range_that_argyll_takes() -> None:
    camera = np.linspace(-0.01, 1.25, 72).reshape(24, 3)
    rows = ti3(color_checker_xyz(), camera).split("BEGIN_DATA\n")[1].split("\nEND_DATA")[0].splitlines()
    device = np.array([[float(word) for word in row.split()[4:]] for row in rows])
    np.testing.assert_allclose(device, 80 * np.maximum(camera, 0), atol=1e-5)


def test_a_calibration_of_the_default_sensor_has_no_name() -> None:
    assert Camera(SensorCalibration()).to_json()["sensor"] == ""
