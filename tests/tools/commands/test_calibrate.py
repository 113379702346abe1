"""The verb: files in, camera.json and report out."""

import json
import re
from dataclasses import replace
from itertools import permutations, product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shared import Camera, CfaPattern, Mosaic, SensorCalibration, read_camera, read_dng, write_dng
from shared.errors import InputError
from shared.sensor import simulate_sensor, typical_noise
from tests.tools.calibration.known_camera import BLIND, TRUTH, chart, frame, true_place
from tests.tools.command import run
from tools.calibration.camera_file import difference, merged, write_camera
from tools.calibration.reference import color_checker_xyz, read_reference, ti3
from tools.cli import main

pytest.importorskip("cv2")
CORNERS = [f"{x:.1f},{y:.1f}" for x, y in true_place().corners]


def panchroma(*words: str | Path) -> int:
    with pytest.raises(SystemExit) as left:
        main([str(word) for word in words])
    return int(left.value.code or 0)


def save(path: Path, mosaic: Mosaic) -> Path:
    write_dng(path, mosaic, np.zeros((20, 30, 3), np.uint8))
    return path


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


def test_a_folder_becomes_a_camera(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "camera.json"
    assert panchroma("calibrate", folder, "-o", output, "--report", tmp_path, "--json") == 0
    camera = read_camera(output)
    assert TRUTH.noise is not None
    assert camera.calibration.noise is not None
    np.testing.assert_allclose(camera.calibration.gamma, TRUTH.gamma, rtol=0.01)
    np.testing.assert_allclose(camera.calibration.black_level, TRUTH.black_level, atol=0.1)
    np.testing.assert_allclose(camera.calibration.noise.shot, TRUTH.noise.shot, rtol=0.06)
    assert set(camera.measured) == {"gamma", "noise", "black_level", "defects", "colour", "shading"}
    assert camera.calibration.shading is None  # the flat frames are even
    assert camera.pattern == read_dng(folder / "chart.dng").pattern
    records = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [record["ok"] for record in records] == [True] * 10
    assert records[-1]["id"] == camera.calibration.id

    page = (tmp_path / "report.html").read_text("utf-8")
    assert "Use it" in page
    assert page.count("<svg") == 3
    assert page.count('class="patch"') == 24
    assert "prefers-color-scheme: dark" in page
    assert not re.search(r'(?:src|href)="(?!data:)', page), "the page loads something"
    np.testing.assert_allclose(read_reference(tmp_path / "chart.ti3"), color_checker_xyz(), atol=1e-6)

    # Refuses to overwrite, and simulates and renders with what was measured.
    assert panchroma("calibrate", folder, "-o", output) == 2
    assert panchroma("simulate", "chart:120x80", "-o", tmp_path, "--camera", output, "--protocol", "sensor") == 0
    assert read_dng(tmp_path / "chart-120x80.dng").calibration.camera == camera.calibration.id
    assert panchroma("render", tmp_path / "chart-120x80.dng", "-o", tmp_path, "--camera", output) == 0
    assert panchroma("simulate", "chart:120x80", "-o", tmp_path, "--camera", output, "--period", "8", "--overwrite") == 2
    assert "period 8" in capsys.readouterr().err
    assert panchroma("inspect", output) == 0
    shown = capsys.readouterr().out
    assert camera.calibration.id in shown
    assert "half_width_95" in shown


def test_update_merges_by_part_and_keeps_the_old_file(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "camera.json"
    assert panchroma("calibrate", folder / "chart.dng", "--corners", *CORNERS, "-o", output) == 0
    before, text = read_camera(output), output.read_text()
    capsys.readouterr()
    assert panchroma("calibrate", "--dark", folder / "dark0.dng", folder / "dark1.dng", "-o", output, "--update") == 0
    after = read_camera(output)
    np.testing.assert_allclose(after.calibration.gamma, before.calibration.gamma, rtol=1e-3)
    np.testing.assert_allclose(after.calibration.camera_to_xyz, before.calibration.camera_to_xyz, atol=1e-3)  # type: ignore[arg-type]
    assert after.calibration.black_level != before.calibration.black_level
    assert (tmp_path / "camera.json.bak").read_text() == text
    assert "black_level: [256, 257, 255, 258] -> " in capsys.readouterr().out
    assert sorted(path.name for path in tmp_path.iterdir()) == ["camera.json", "camera.json.bak"]


def test_bad_shots_are_skipped_with_a_line_and_nothing_is_written_without_a_good_one(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    grey = save(tmp_path / "grey.dng", frame(np.full((60, 90, 3), 0.2)))
    output = tmp_path / "camera.json"
    assert panchroma("calibrate", grey, tmp_path / "absent.dng", "-o", output) == 1
    errors = capsys.readouterr().err
    assert "no ColorChecker was found" in errors
    assert "absent.dng" in errors
    assert not output.exists()
    other = save(tmp_path / "other.dng", frame(chart().rgb, 8))
    assert panchroma("calibrate", folder / "chart.dng", other, "-o", output) == 1
    assert "period 8" in capsys.readouterr().err
    assert read_camera(output).calibration.gamma == pytest.approx(TRUTH.gamma, rel=0.02)


def test_what_cannot_work_is_refused_before_the_work(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shot = folder / "chart.dng"
    commands: tuple[tuple[list[str | Path], str], ...] = (
        (["-o", tmp_path / "camera.json"], "nothing to calibrate from"),
        ([shot, "-o", tmp_path], "is a folder"),
        ([shot, "-o", tmp_path / "no" / "camera.json"], "does not exist"),
        ([shot, shot, "--corners", *CORNERS, "-o", tmp_path / "camera.json"], "one shot"),
        ([shot, "--corners", "1", "2", "3", "4", "-o", tmp_path / "camera.json"], "is not 2 numbers with commas between them"),
        ([shot, "-o", shot, "--overwrite"], "is an input"),
    )
    for words, why in commands:
        assert panchroma("calibrate", *words) == 2
        assert why in capsys.readouterr().err


def camera(measured: tuple[str, ...], **changes: Any) -> Camera:
    pattern = frame(np.zeros((12, 12, 3))).pattern
    return Camera(replace(BLIND, **changes), pattern, {part: {"date": "2026-01-01"} for part in measured})


def test_a_merge_takes_only_what_was_measured() -> None:
    old = camera(("noise", "black_level"), noise=TRUTH.noise, black_level=(10.0,) * 4)
    new = camera(("gamma",), gamma=(2.0, 2.0, 2.0), black_level=(20.0,) * 4)
    both = merged(old, new, ["noise", "black_level"])
    assert both.calibration.black_level == (10.0,) * 4
    assert both.calibration.gamma == (2.0, 2.0, 2.0)
    assert both.calibration.noise is not None
    assert TRUTH.noise is not None
    # The same noise in codes: scene units per code have doubled.
    np.testing.assert_allclose(both.calibration.noise.shot, 2 * np.array(TRUTH.noise.shot))
    assert set(both.measured) == {"gamma", "noise", "black_level"}
    assert [line for line in difference(old, both) if line.startswith("gamma")] == ["gamma: [1, 1, 1] -> [2, 2, 2]"]
    alike = replace(old, calibration=replace(old.calibration, gamma=(1 + 1e-9, 1.0, 1.0)))
    assert not difference(old, alike)


def test_another_sensor_is_not_updated(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "camera.json"
    write_camera(path, camera(("gamma",)))
    text = path.read_text()
    dark = np.zeros((60, 90, 3))
    for says, words in (
        (replace(BLIND, sensor="other"), r"camera.json: .*'other'.*'bench'"),
        (replace(BLIND, white_level=4000), "white level 4000, the camera file 4095"),
    ):
        other = save(tmp_path / "other.dng", frame(dark, says=says))
        assert panchroma("calibrate", "--dark", other, "-o", path, "--update") == 2
        assert re.search(words, capsys.readouterr().err)
        assert path.read_text() == text
        other.unlink()


def test_what_an_earlier_version_knew_better_stays_and_is_not_judged(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its files keep no figures. The noise of its flat frames is better known than that of a chart."""
    path = tmp_path / "camera.json"
    old = camera(("noise",), noise=TRUTH.noise)
    old = replace(old, measured={"noise": {"from": "4 pairs of flat frames", "shot_error": [1e-6] * 4}})
    write_camera(path, old)
    assert panchroma("calibrate", folder / "chart.dng", "--corners", *CORNERS, "-o", path, "--update") == 0
    new = read_camera(path)
    assert new.measured["noise"] == old.measured["noise"]
    assert TRUTH.noise is not None
    assert new.calibration.noise is not None
    ratio = new.calibration.full_scale / old.calibration.full_scale
    np.testing.assert_allclose(new.calibration.noise.shot, ratio * np.array(TRUTH.noise.shot))
    captured = capsys.readouterr()
    assert "does not keep what its noise came from: these are not judged anew" in captured.err
    assert "use it with care" in captured.out


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


def test_every_order_of_updates_ends_like_one_command(folder: Path, tmp_path: Path) -> None:
    """The shots state a black level that is 5 to 8 codes off, so a chart must be judged again when the dark frames come."""
    loose = replace(BLIND, black_level=(250.0,) * 4)
    for name in (word for words in STEPS.values() for word in words if word.endswith(".dng")):
        save(tmp_path / name, Mosaic(read_dng(folder / name).codes, CfaPattern.bayer(), loose))
    folder = tmp_path
    whole = calibrated(folder, tmp_path / "whole.json", *STEPS)
    known = read_camera(tmp_path / "whole.json")
    assert whole["verdict"] == "use it"
    assert TRUTH.noise is not None
    for number, order in enumerate(permutations(STEPS)):
        path = tmp_path / f"{number}.json"
        records = [calibrated(folder, path, step) for step in order]
        camera = read_camera(path)
        assert (records[-1]["verdict"], records[-1]["warnings"]) == (whole["verdict"], whole["warnings"]), order
        assert set(camera.measured) == set(known.measured)
        for one, other, half in (
            (camera.calibration.gamma, known.calibration.gamma, known.measured["gamma"]["half_width_95"]),
            (camera.calibration.black_level, known.calibration.black_level, known.measured["black_level"]["standard_error"]),
            (camera.calibration.noise.shot, known.calibration.noise.shot, known.measured["noise"]["shot_error"]),  # type: ignore[union-attr]
            (camera.calibration.noise.read, known.calibration.noise.read, known.measured["noise"]["read_error"]),  # type: ignore[union-attr]
        ):
            assert (np.abs(np.subtract(one, other)) <= 0.2 * np.array(half)).all(), order
        np.testing.assert_allclose(camera.calibration.camera_to_xyz, known.calibration.camera_to_xyz, atol=2e-3)  # type: ignore[arg-type]
        assert camera.calibration.defects == known.calibration.defects
    # The same frames once more change nothing, and what is less known replaces nothing.
    again = calibrated(folder, path, "chart")
    assert again["verdict"] == whole["verdict"]
    outcome = run("calibrate", "--dark", folder / "dark0.dng", "-o", path, "--update")
    assert "the dark frames before are kept" in outcome.err
    assert read_camera(path).measured["black_level"]["frames"] == 2


@pytest.mark.parametrize("camera", [[], ["--period", "4", "--sensor-bits", "16"]])
def test_the_built_in_scenes_make_a_camera_to_use(camera: list[str], tmp_path: Path) -> None:
    """As the README tells a newcomer who has no camera; two flat frames of the same seed are refused."""
    frames: dict[str, list[Path]] = {"chart": [], "dark": [], "flat": []}
    for kind, light, seed in (("chart", 1, 0), *product(["dark"], [1], (1, 2, 3, 4)), *product(["flat"], (0.1, 0.3, 0.6), (1, 2))):
        to = tmp_path / f"{kind}{light}-{seed}"
        options = ["--protocol", "sensor", "--seed", str(seed), *camera]
        if light != 1:
            options += ["--light", str(light)]
        outcome = run("simulate", f"{kind}:720x480", "-o", to, *options)
        assert outcome.code == 0, outcome.err
        frames[kind] += to.iterdir()
    output = tmp_path / "camera.json"
    outcome = run("calibrate", *frames["chart"], "--dark", *frames["dark"], "--flat", *frames["flat"], "-o", output, "--json")
    assert (outcome.code, outcome.records[-1]["warnings"]) == (0, [])
    assert outcome.records[-1]["verdict"] == "use it"
    known = read_camera(output).calibration
    np.testing.assert_allclose(known.gamma, (1, 1, 1), rtol=0.01)
    typical = typical_noise(known)
    assert known.noise is not None
    np.testing.assert_allclose(known.noise.shot, typical.shot, rtol=0.05)
    np.testing.assert_allclose(known.noise.read, typical.read, rtol=0.05)
    again = tmp_path / "again"
    assert run("simulate", "flat:720x480", "-o", again, "--protocol", "sensor", "--light", "0.3", "--seed", "1", *camera).code == 0
    copies = [tmp_path / "flat0.3-1" / "flat-720x480.dng", again / "flat-720x480.dng"]
    outcome = run("calibrate", "--flat", *copies, "--dark", *frames["dark"], "-o", tmp_path / "none.json")
    assert outcome.code == 1
    assert "have the same noise" in outcome.err


def test_the_read_noise_of_dark_frames_reaches_the_noise_of_a_chart(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "camera.json"
    first = calibrated(folder, path, "chart")
    assert any("read noise" in warning for warning in first["warnings"])
    second = calibrated(folder, path, "dark")
    assert TRUTH.noise is not None
    np.testing.assert_allclose(second["camera"]["noise"]["read"], TRUTH.noise.read, rtol=0.05)
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
    assert run("calibrate", other, "--dark", folder / "dark0.dng", folder / "dark1.dng", "-o", output, "--update").code == 1
    assert read_camera(output).calibration.gamma == pytest.approx(known, rel=1e-3)


@pytest.mark.parametrize("kind", ["dark", "flat"])
def test_a_frame_and_its_copy_measure_nothing(kind: str, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    name = "dark0.dng" if kind == "dark" else "flat50.dng"
    copy = save(tmp_path / "copy.dng", read_dng(folder / name))
    output = tmp_path / "camera.json"
    assert panchroma("calibrate", f"--{kind}", folder / name, copy, "-o", output) == 1
    assert "copy.dng and " in (said := capsys.readouterr().err)
    assert "have the same noise" in said
    assert not output.exists()


@pytest.mark.parametrize(("order", "says"), [("BGGR", "RGGB"), ("GRBG", "GBRG"), ("RGGB", "BGGR")])
def test_red_and_blue_exchanged_show_on_the_chart(
    order: str, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    right, wrong = (CfaPattern.bayer(6, letters) for letters in (order, says))
    taken = simulate_sensor(chart().rgb, right, TRUTH, 1.0, np.random.default_rng(0))
    shot = save(tmp_path / "chart.dng", Mosaic(taken.codes, wrong, BLIND))
    assert panchroma("calibrate", shot, "-o", tmp_path / "camera.json") == 1
    said = capsys.readouterr().err
    assert "the chart shows that red and blue are exchanged" in said
    assert "/".join(right.letters_from()) in said
    assert not (tmp_path / "camera.json").exists()


def test_a_scattered_tile_of_cyan_magenta_and_yellow_from_end_to_end(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    right, wrong = (CfaPattern.of_letters(tile, (0, 1), "CMY") for tile in ("WYWC/YWCW/WCWM/CWMW", "WMWC/MWCW/WCWY/CWYW"))
    camera, light = replace(TRUTH, channels="CMY"), (chart().rgb @ (1 - np.eye(3)) / 2).astype(np.float32)
    says = replace(BLIND, channels="CMY")
    for name, pattern in (("chart", right), ("exchanged", wrong)):
        codes = simulate_sensor(light, right, camera, 1.0, np.random.default_rng(0)).codes
        save(tmp_path / f"{name}.dng", Mosaic(codes, pattern, says))
    for number, level in enumerate((0.0, 0.0, 0.1, 0.1, 0.8, 0.8)):
        even = np.full((*chart().shape, 3), level, np.float32)
        codes = simulate_sensor(even, right, camera, 1.0, np.random.default_rng(number)).codes
        save(tmp_path / f"{'flat' if level else 'dark'}{number}.dng", Mosaic(codes, right, says))
    output = tmp_path / "camera.json"
    (tmp_path / "exchanged.dng").rename(tmp_path / "exchanged")
    assert panchroma("calibrate", tmp_path, "-o", output, "--report", tmp_path) == 0
    measured = read_camera(output)
    np.testing.assert_allclose(measured.calibration.gamma, TRUTH.gamma, rtol=0.01)
    np.testing.assert_allclose(measured.calibration.noise.shot, TRUTH.noise.shot, rtol=0.1)  # type: ignore[union-attr]
    assert measured.pattern == right
    capsys.readouterr()
    assert panchroma("calibrate", (tmp_path / "exchanged").rename(tmp_path / "exchanged.dng"), "-o", tmp_path / "no.json") == 1
    said = capsys.readouterr().err
    assert "magenta and yellow are exchanged" in said
    assert "/".join(right.letters_from()) in said


def test_no_copy_of_an_old_file_is_ever_replaced(tmp_path: Path) -> None:
    path = tmp_path / "camera.json"
    (tmp_path / "camera.json.bak").write_text("mine")
    (tmp_path / "camera.json.bak2").symlink_to("nowhere")
    texts = []
    for number in range(3):
        write_camera(path, camera(("gamma",), gamma=(1.0, 1.0 + number, 1.0)), overwrite=True)
        texts.append(path.read_text())
    assert (tmp_path / "camera.json.bak").read_text() == "mine"
    assert (tmp_path / "camera.json.bak2").is_symlink()
    assert [(tmp_path / f"camera.json.bak{number}").read_text() for number in (3, 4)] == texts[:2]


@pytest.mark.parametrize(
    "damage",
    [
        {"gamma": 7},
        {"gamma": {"charts": [{}], "scenes": []}},
        {"gamma": {"charts": 1, "scenes": []}},
        {"gamma": {"charts": [{"name": "x", "black_level": [256] * 4, "camera_to_xyz": None, "fits": []}], "scenes": []}},
        {"gamma": {"charts": [], "scenes": [{"name": "x", "black_level": [256] * 4, "camera_to_xyz": None, "fits": []}]}},
        {"black_level": {"frames": -1}},
        {"black_level": {"frames": 2, **dict.fromkeys(("black", "black_error", "read", "read_error"), [1e308] * 4)}},
        {"noise": {"pairs": 1, "black_level": [0] * 4, "mean": [[]], "variance": [[]], "count": [[]]}},
        {"noise": {"pairs": 1, "black_level": [0] * 4, "mean": [[0.5] * 4], "variance": [[-1] * 4], "count": [[9] * 4]}},
        {"defects": {"dead": [[1e308, 2]]}},
    ],
)
def test_a_damaged_camera_file_is_refused_by_part(
    damage: dict[str, Any], folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "camera.json"
    write_camera(path, replace(camera(()), measured={part: {"kept": kept} for part, kept in damage.items()}))
    assert panchroma("calibrate", "--dark", folder / "dark0.dng", "-o", path, "--update") == 2
    assert f"camera.json: camera: measured.{next(iter(damage))}.kept is damaged" in capsys.readouterr().err


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
