"""The verb: files in, camera.json and report out."""

import re
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from panchroma.shared import (
    Camera,
    CfaPattern,
    InputError,
    NoiseModel,
    SensorCalibration,
    read_camera,
    read_dng,
)
from panchroma.shared.colorimetry import D50
from panchroma.tools.calibration.files import sort_files, write_camera
from panchroma.tools.calibration.reference import read_reference
from panchroma.tools.io.colour import xyz_to_lab
from panchroma.tools.simulation.drawn.charts import color_checker_xyz
from panchroma.tools.simulation.sensor import simulate_sensor, typical_noise
from tests.tools.calibration.known_camera import (
    BLIND,
    NOISE,
    TRUTH,
    cgats,
    chart,
    frame,
    save,
    true_place,
)
from tests.tools.command import repeated, run, spawn

CORNERS = [f"{x:.1f},{y:.1f}" for x, y in true_place().corners]
STEPS: dict[str, list[Any]] = {
    "chart": ["chart.dng", "--corners", *CORNERS],
    "dark": repeated("--dark", ("dark0.dng", "dark1.dng")),
    "flat": repeated("--flat", [f"flat{number}.dng" for number in (10, 11, 50, 51, 80, 81)]),
}


def calibrated(folder: Path, output: Path, *steps: str) -> dict[str, Any]:
    """The last record of `calibrate --update` with the frames of these steps."""
    every = [word for step in steps for word in STEPS[step]]
    words = [str(folder / word) if word.endswith(".dng") else word for word in every]
    return run("calibrate", *words, "-o", output, "--update", "--json", code=0).records[-1]


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


def test_the_camera_is_there_if_its_report_fails(folder: Path, tmp_path: Path) -> None:
    """For want of a file of settings that matplotlib can read."""
    output, report = tmp_path / "camera.json", tmp_path / "made" / "report.html"
    (tmp_path / "matplotlibrc").write_bytes(b"# caf\xe9\n")
    line = ("calibrate", folder / "chart.dng", "-o", output, "--report", report.parent, "--json")
    outcome = spawn(*line, cwd=tmp_path, code=1)
    (error,) = outcome.errors
    assert error.startswith(f"panchroma: {report}: matplotlib cannot read its settings (")
    assert "matplotlibrc" in error
    read_camera(output)
    ends = [(record["source"], record["ok"]) for record in outcome.records[-2:]]
    assert ends == [(str(output), True), (str(report), False)]


def test_an_update_replaces_what_was_measured(folder: Path, tmp_path: Path) -> None:
    output = tmp_path / "camera.json"
    first = calibrated(folder, output, "chart")
    assert first["verdict"] == "use it with care"
    assert any("noise: not measured" in line for line in first["warnings"])
    assert "not measured; take flat frames (--flat)" in first["warnings"][-1]
    before, text = read_camera(output), output.read_text()
    darks = repeated("--dark", folder.glob("dark*"))
    outcome = run("calibrate", *darks, "-o", output, "--update", code=0)
    after = read_camera(output)
    replaced = {part: getattr(after.calibration, part) for part in ("black_level", "defects")}
    assert after.calibration == replace(before.calibration, **replaced, camera=after.calibration.id)
    kept = {part: how for part, how in after.measured.items() if part not in replaced}
    assert kept == before.measured
    assert (tmp_path / "camera.json.bak").read_text() == text
    assert "measured now: black_level, defects; kept as it was: gamma, colour" in outcome.out
    said = r"with care; not measured: noise \(take pairs of.*\), shading \(take flat .*\)\n$"
    assert re.search(said, outcome.out)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["camera.json", "camera.json.bak"]


def test_noise_beyond_the_intervals_asks_for_overwrite(folder: Path, tmp_path: Path) -> None:
    output = tmp_path / "camera.json"
    words: list[str | Path] = ["-o", output, "--update"]
    calibrated(folder, output, "dark", "flat")
    text = output.read_bytes()
    for number, light in enumerate(np.repeat((0.1, 0.4, 0.8), 2)):
        even = np.full((*chart().shape, 3), light, np.float32)
        noises = {"same": TRUTH.noise, "loud": NoiseModel(*4 * np.array([NOISE.shot, NOISE.read]))}
        for name, noise in noises.items():
            truth, random = replace(TRUTH, noise=noise), np.random.default_rng(90 + number)
            taken = simulate_sensor(even, CfaPattern.bayer(6), truth, 1.0, random)
            save(tmp_path / f"{name}{number}.dng", replace(taken, calibration=BLIND))
    loud, same = (repeated("--flat", tmp_path.glob(f"{name}*")) for name in ("loud", "same"))
    outcome = run("calibrate", *loud, *words, code=1)
    said = r"camera.json: what is replaced moves: photon noise by \+\d{3} to .*add --overwrite"
    assert re.search(said, outcome.err)
    assert output.read_bytes() == text
    assert "moves: photon noise by -" in run("calibrate", *same, *words, code=0).out
    before = read_camera(output).calibration.noise.shot
    run("calibrate", *loud, *words, "--overwrite", code=0)
    assert read_camera(output).calibration.noise.shot[3] > 3 * before[3]


def test_without_a_good_shot_nothing_is_written(folder: Path, tmp_path: Path) -> None:
    halves, output = np.full((60, 90, 3), 0.2), tmp_path / "camera.json"
    halves[:, 45:] = 0.5
    grey, absent = save(tmp_path / "grey.dng", frame(halves)), tmp_path / "absent.dng"
    copy = save(tmp_path / "copy.dng", read_dng(folder / "dark0.dng"))
    darks = repeated("--dark", (folder / "dark0.dng", copy))
    lines = run("calibrate", grey, absent, "-o", output, code=1).errors
    assert re.search("no ColorChecker was found.*: --corners x,y x,y x,y x,y$", lines[0])
    assert f"{absent}: there is no such file" in lines[1]
    lines = run("calibrate", grey, *darks, "-o", output, code=1).errors
    assert re.search("copy.dng: it is the same shot as .*dark0.dng", lines[0])
    assert not output.exists()


def test_a_chart_among_dark_frames_is_named(folder: Path, tmp_path: Path) -> None:
    dim = save(tmp_path / "dim.dng", frame(0.1 * chart().rgb))
    darks = repeated("--dark", [*folder.glob("dark*"), dim])
    (line, *_) = run("calibrate", *darks, "-o", tmp_path / "camera.json", code=1).errors
    assert re.search(r"the noise of \S+dark\d\.dng is .* codes, of \S+dim\.dng ", line)


def test_no_gamma_is_stated_that_was_not_measured(folder: Path, tmp_path: Path) -> None:
    """The only chart is of another period, and is skipped: then there is no camera. Without a chart
    the verdict says so.
    """
    other, output = save(tmp_path / "other.dng", frame(chart().rgb, 8)), tmp_path / "camera.json"
    darks = repeated("--dark", (folder / "dark0.dng", folder / "dark1.dng"))
    outcome = run("calibrate", other, *darks, "-o", output, "--json")
    assert (outcome.code, outcome.records[-1]["ok"], output.exists()) == (1, False, False)
    assert "period 8" in outcome.err
    assert "gamma is not known, for no chart could be used, and no camera file" in outcome.err
    record = calibrated(folder, output, "dark")
    assert record["verdict"] == "use it with care"
    assert any("gamma: not measured" in warning for warning in record["warnings"])
    calibrated(folder, again := tmp_path / "again.json", "dark")
    assert again.read_bytes() == output.read_bytes(), "equal frames make equal files"
    # A gamma that is known already stays, whatever becomes of further charts.
    calibrated(folder, output, "chart")
    known = read_camera(output).calibration.gamma
    run("calibrate", other, *darks, "-o", output, "--update", code=1)
    assert read_camera(output).calibration.gamma == known


@pytest.mark.parametrize(
    ("measured", "says", "words"),
    [
        ({"gamma": {}}, replace(BLIND, sensor="other"), r"camera.json: .*'other'.*'bench'"),
        ({"gamma": {}}, replace(BLIND, white_level=4000), "level 4000, the camera file 4095"),
        ({"black_level": {"standard_error": [1.0] * 3}}, BLIND, "black_level.standard_error "),
        ({"gamma": {"half_width_95": [1.0] * 4}}, BLIND, "gamma.half_width_95 "),
        ({"noise": {"read_error": 3}}, BLIND, "noise.read_error "),
        ({"noise": {"shot_error": ["1"] * 4}}, BLIND, "noise.shot_error "),
    ],
)
def test_another_sensor_and_a_damaged_file_are_not_updated(
    measured: dict[str, Any], says: SensorCalibration, words: str, tmp_path: Path
) -> None:
    path = tmp_path / "camera.json"
    write_camera(path, Camera(BLIND, CfaPattern.bayer(6), measured))
    text = path.read_text()
    other = save(tmp_path / "other.dng", frame(np.zeros((60, 90, 3)), says=says))
    said = run("calibrate", "--dark", other, "-o", path, "--update", code=2).err
    assert re.search(words if says is not BLIND else rf"camera.json: measured\.{words}", said)
    assert path.read_text() == text


def test_a_folder_of_built_in_scenes_becomes_a_camera_to_use(tmp_path: Path) -> None:
    """As the README tells a newcomer who has no camera."""
    frames, output, made = tmp_path / "frames", tmp_path / "camera.json", tmp_path / "made"
    exposures = [("chart", 1, 0), *product(["dark"], [1], range(4))]
    for kind, light, seed in (*exposures, *product(["flat"], (0.1, 0.3, 0.6), (1, 2))):
        (folder := frames / f"{kind}{light}-{seed}").mkdir(parents=True)
        run("simulate", f"{kind}:480x320", f"--light {light} --seed {seed} -o", folder, code=0)
    line = ("calibrate", frames, "-o", output)
    *of_frames, record = run(*line, "--report", made, "--json", code=0).records
    camera = read_camera(output)
    assert [each["ok"] for each in of_frames] == [True] * 11
    assert (record["ok"], record["verdict"], record["warnings"]) == (True, "use it", [])
    assert record["id"] == camera.calibration.id
    assert set(camera.measured) == {"gamma", "noise", "black_level", "defects", "colour", "shading"}
    assert (camera.calibration.shading, camera.pattern) == (None, CfaPattern.bayer())  # even light
    np.testing.assert_allclose(camera.calibration.gamma, (1, 1, 1), rtol=0.01)
    noise, typical = camera.calibration.noise, typical_noise(camera.calibration)
    np.testing.assert_allclose((noise.shot, noise.read), (typical.shot, typical.read), rtol=0.05)
    page = (made / "report.html").read_text("utf-8")
    counted = {"Use it": 1, "<img": 3, 'class="patch"': 24}
    assert {words: page.count(words) for words in counted} == counted
    assert not re.search(r'(?:src|href)="(?!data:)', page), "the page loads something"
    text = output.read_bytes()
    run(*line, code=2)
    assert output.read_bytes() == text


def test_a_frame_is_of_one_kind_and_counts_once(tmp_path: Path) -> None:
    for name in ("chart", "flat0", "dark/a", "covered/b"):
        (tmp_path / f"{name}.dng").parent.mkdir(exist_ok=True)
        (tmp_path / f"{name}.dng").touch()
    (tmp_path / "link.dng").symlink_to("covered/b.dng")
    top = str(tmp_path)

    def sorted_files(**given: list[str]) -> dict[str, list[str]]:
        files, _ = sort_files({"shots": [], "dark": [], "flat": [], **given})
        return {kind: [name.removeprefix(f"{top}/") for name in files[kind]] for kind in files}

    # What a folder of shots holds may be named, too, and then is what it is named as.
    darks = ["dark/a.dng", "covered/b.dng"]
    whole = {"shots": ["chart.dng"], "dark": darks, "flat": ["flat0.dng"]}
    named = [f"{top}/dark", f"{top}/covered", f"{top}/link.dng"]
    assert sorted_files(shots=[top, f"{top}/./chart.dng"], dark=named) == whole
    for wrong in (
        {"dark": [f"{top}/dark"], "flat": [f"{top}/dark/../dark/a.dng"]},
        {"dark": [f"{top}/covered"], "shots": [f"{top}/link.dng"]},
    ):
        with pytest.raises(InputError, match=r"dng: is given as \w+ and as \w+; a frame is of one"):
            sorted_files(**wrong)


REFERENCE = color_checker_xyz()
NAMES = [f"{'ABCDEF'[index % 6]}{index // 6 + 1}" for index in range(24)]
BY_ROW = [f"{'ABCD'[index // 6]}{index % 6 + 1}" for index in range(24)]
XYZ, LAB = "XYZ_X XYZ_Y XYZ_Z", "LAB_L LAB_A LAB_B"


def read(path: Path, text: str) -> np.ndarray:
    path.write_text(text)
    return read_reference(path)


TURNED = np.random.default_rng(0).permutation(24)
READ = {
    "0 to 1": cgats(REFERENCE),
    "0 to 100": cgats(100 * REFERENCE),
    "X-Rite's": cgats(xyz_to_lab(REFERENCE), "Lab_L Lab_a Lab_b").replace(".", ","),
    "any order": cgats(REFERENCE[TURNED], names=[NAMES[index] for index in TURNED]),
    "rows named by letters": cgats(REFERENCE[TURNED], names=[BY_ROW[index] for index in TURNED]),
    "numbered": cgats(REFERENCE[TURNED], names=[str(index + 1) for index in TURNED]),
}  # fmt: skip


@pytest.mark.parametrize("form", READ)
def test_a_reference_is_read_in_every_form(form: str, tmp_path: Path) -> None:
    np.testing.assert_allclose(read(tmp_path / "chart.cie", READ[form]), REFERENCE, atol=2e-6)


D65 = np.array([0.95047, 1, 1.08883])
WRONG = {
    "no table": ("CTI3", "is not a CGATS file"),
    "no colours": (cgats(REFERENCE, "ABC_X ABC_Y ABC_Z"), "has neither XYZ_X"),
    "a patch missing": (cgats(REFERENCE[:23], names=NAMES[:23]), "23 patches .*, expected 24"),
    "no numbers": (cgats(REFERENCE).replace(".", ":"), "could not convert string to float"),
    "in candela": (cgats(12 * REFERENCE), "has XYZ_Y 10.* expected about 0.9"),
    "encoded Lab": (cgats(np.add(xyz_to_lab(REFERENCE), (0, 128, 128)), LAB), "the grey row"),
    "for D65": (cgats(REFERENCE * D65 / D50), "the grey row has a tint .* another light than D50"),
    "upside down": (cgats(REFERENCE[::-1]), "the white patch .A4. has|the grey row"),
}


@pytest.mark.parametrize("fault", WRONG)
def test_a_wrong_reference_is_refused_by_name(fault: str, tmp_path: Path) -> None:
    text, words = WRONG[fault]
    with pytest.raises(InputError, match=f"chart.cie: .*(?:{words})"):
        read(tmp_path / "chart.cie", text)
