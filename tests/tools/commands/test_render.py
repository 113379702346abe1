"""`panchroma render`: the command gives what the library gives, in every format, and a bad shot costs one line."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import tifffile
from numpy.typing import ArrayLike
from PIL import Image

from panchroma.offline import PAPER, PRESETS, render
from panchroma.shared import CaptureMetadata, CfaPattern, Mosaic, SensorCalibration, read_dng
from panchroma.shared.arrays import ByteArray, FloatArray
from panchroma.tools.commands.simulate import noise_of
from panchroma.tools.evaluation.metrics import psnr
from panchroma.tools.io.development import Development
from panchroma.tools.io.formats import FORMATS
from panchroma.tools.io.kind import PictureKind
from panchroma.tools.simulation.drawn.builtin import builtin_scene
from panchroma.tools.simulation.sensor import simulate_additive, simulate_sensor
from tests.shared.test_white_balance import LIGHT
from tests.shared.test_white_balance import shot as coloured_light
from tests.tools.batch.examples import save_mosaic
from tests.tools.command import assert_refused, results, run
from tests.tools.io.examples import encode_picture

SCENE = (48, 36)
SOURCE = f"builtin:{SCENE[0]}x{SCENE[1]}"
STEM = SOURCE.replace(":", "-")
MEASURED = ("--preset", "paper", "--bits", "32", "--space", "camera")


def test_what_is_lost_is_white_where_it_is_lost_in_a_picture_of_several_bands(
    tmp_path: Path, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(1)
    lamps = np.repeat(np.repeat(rng.uniform(0, 3, (25, 3, 3)).astype(np.float32), 24, axis=0), 24, axis=1)
    mosaic = simulate_sensor(lamps, CfaPattern.bayer(6), SensorCalibration.of_bits(12, headroom=False), 1.0, rng)
    lamp = save_mosaic(tmp_path / "lamps.dng", mosaic)
    shown: list[ByteArray] = []
    whitened = Development.whitened

    def recorded(self: Development, rgb: FloatArray, lost: ByteArray | None) -> FloatArray:
        shown.append(lost)
        return whitened(self, rgb, lost)

    monkeypatch.setattr(Development, "whitened", recorded)
    run("render", lamp, "-o", out, code=0)
    assert len(shown) > 1
    expected = render(read_dng(lamp), PRESETS["best"]).lost
    assert expected.any()
    assert np.array_equal(np.concatenate(shown), expected)


@pytest.fixture(scope="module")
def shot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A noisy shot of the built-in scene, 16 bits, with its truth beside it."""
    folder = tmp_path_factory.mktemp("shots")
    run("simulate", SOURCE, "-o", folder, "--bits", "16", "--sigma", "0.02", "--truth", code=0)
    return folder / f"{STEM}.dng"


def save(path: Path, codes: ArrayLike | None = None) -> Path:
    """A shot of these codes, of random ones without, 13 x 17."""
    samples = np.random.default_rng(0).integers(256, 3839, (13, 17), np.uint16)
    if codes is not None:
        samples[:] = codes
    metadata = CaptureMetadata(make="Contax", iso=400, orientation=6)
    return save_mosaic(path, Mosaic(samples, CfaPattern.bayer(), SensorCalibration.of_bits(12), metadata))


# --- what is made ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("sigma", "period"), [(0.0, 6), (0.02, 4)])
def test_the_command_gives_what_the_library_gives(out: Path, sigma: float, period: int) -> None:
    """Scene -> DNG -> picture on disk, beside scene -> picture in memory."""
    options = ["--pattern", f"K={period}", "--origin", "2,1", "--sigma", str(sigma), "--seed", "5"]
    run("simulate", SOURCE, "-o", out, "--bits", "16", "--truth", *options, code=0)
    run("render", out / f"{STEM}.dng", "-o", out, *MEASURED, code=0)
    rendered, truth = tifffile.imread(out / f"{STEM}.tif"), tifffile.imread(out / f"{STEM}.truth.tif")
    assert rendered.dtype == truth.dtype == np.float32
    assert rendered.shape == truth.shape

    calibration = SensorCalibration.of_bits(16)
    scene = builtin_scene(*SCENE)
    mosaic = simulate_additive(
        scene.rgb, CfaPattern.bayer(period, origin=(2, 1)), calibration, sigma, noise_of(5, f"{STEM}.dng"), scene.metadata
    )
    quantised = Mosaic(mosaic.codes, mosaic.pattern, mosaic.calibration)
    assert np.array_equal(rendered, render(quantised, PAPER).rgb)
    # Half a code of 16 bits is 3e-5 scene units; a median may choose another block for it, so a few pixels differ more.
    unquantised = render(mosaic, PAPER).rgb
    assert np.median(np.abs(rendered - unquantised)) < 1e-4
    assert psnr(rendered, truth) == pytest.approx(psnr(unquantised, truth), abs=0.05)


@pytest.mark.parametrize(
    "options", [*((name,) for name in FORMATS), ("jpg", "--quality", "30"), ("exr", "--space", "camera", "--bits", "16")]
)
@pytest.mark.parametrize("exposure", [0.0, 1.0])
def test_the_file_is_what_the_library_writes(out: Path, tmp_path: Path, options: tuple[str, ...], exposure: float) -> None:
    """Upright, with capture data; of the kind that is usual for the format, or the one that is asked for."""
    asked = dict(zip(options[1::2], options[2::2], strict=True))
    kind = PictureKind.of(
        options[0],
        int(asked["--bits"]) if "--bits" in asked else None,
        asked.get("--space"),
        int(asked["--quality"]) if "--quality" in asked else None,
    )
    if kind.space == "camera":
        exposure = 0.0
    shot = save(tmp_path / "shot.dng")
    outcome = run("render", shot, "-o", out, "-f", *options, "--exposure", str(exposure), code=0)
    mosaic, path = read_dng(shot), out / f"shot{kind.suffix}"
    rendering, development = render(mosaic), Development(kind, mosaic.shape, mosaic.calibration, mosaic.metadata, exposure)
    assert path.read_bytes() == encode_picture(development.whitened(rendering.rgb, rendering.lost), development)
    assert results(out) == {path.name}
    rows, columns = (13, 17) if kind.space == "camera" else (17, 13)
    assert outcome.out.startswith(f"{path}: {columns} x {rows}, {kind.bits} bits, {kind.space}, ")


@pytest.mark.parametrize(("name", "ending"), [("tiff", "tif"), ("jpeg", "jpg")])
def test_formats_have_their_other_names(out: Path, shot: Path, name: str, ending: str) -> None:
    run("render", shot, "-o", out, "-f", name, code=0)
    assert results(out) == {f"{shot.stem}.{ending}"}


def uncalibrated(path: Path, level: float = 0.8) -> Path:
    """A shot of a grey scene under coloured light by a sensor that nobody has calibrated."""
    return save_mosaic(path, Mosaic(coloured_light(level=level).codes, CfaPattern.bayer(6), SensorCalibration.of_bits(12)))


def cast(path: Path) -> float:
    """How far the picture's mean colour is from grey."""
    mean = np.asarray(tifffile.imread(path) if path.suffix == ".tif" else Image.open(path)).mean(axis=(0, 1))
    return float(np.ptp(mean) / mean.mean())


def test_white_balance_as_shot_estimated_and_given(out: Path, tmp_path: Path) -> None:
    shot = uncalibrated(tmp_path / "a.dng")
    multipliers = ",".join(str(1 / each) for each in LIGHT)
    for options, balanced_ in (((), False), (("--wb", "auto"), True), (("--wb", multipliers), True), (("--wb", "camera"), False)):
        for kind in ("tif", "png", "jpg"):
            outcome = run("render", shot, "-o", out, "-f", kind, "--preset", "paper", "--overwrite", *options, "--json", code=0)
            assert (cast(out / f"a.{kind}") < 0.03) == balanced_, (kind, options)
            assert ("white balance is unknown" in outcome.err) == (not balanced_)
            assert outcome.records[0]["neutral_estimated"] == (options == ("--wb", "auto"))
        run("render", shot, "-o", out, "-f", "dng", "--preset", "paper", "--overwrite", *options, code=0)
        with tifffile.TiffFile(out / "a.dng") as file:
            stated = np.array(file.pages.first.tags.valueof(50728)).reshape(3, 2)
        assert np.allclose(stated[:, 0] / stated[:, 1], LIGHT if balanced_ else 1, atol=0.05)


def test_a_white_balance_that_a_shot_does_not_allow(out: Path, tmp_path: Path) -> None:
    dim = uncalibrated(tmp_path / "dim.dng", level=0.004)
    assert_refused(run("render", dim, "-o", out, "--wb", "auto"), "too dark, too bright or too small", name=str(dim))
    assert_refused(run("render", dim, "-o", out, "--wb", "2,1"), "`wb` has 2 multipliers", "R, G, B", name=str(dim))


def test_a_dry_run_checks_and_does_nothing(out: Path, shot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise AssertionError("rendered")

    monkeypatch.setattr("panchroma.offline.measure", fail)
    (tmp_path / "text.dng").write_text("no picture")
    (out / "old.tif").write_text("old")
    old = save(tmp_path / "old.dng")
    outcome = run("render", shot, tmp_path / "text.dng", old, "-o", out, "--dry-run", "--json", code=1)
    found = {Path(record["source"]).name: (record["ok"], record.get("dry_run")) for record in outcome.records}
    assert found == {shot.name: (True, True), "text.dng": (False, None), "old.dng": (False, None)}
    assert f"{shot} -> {out / f'{STEM}.tif'}" in outcome.err
    assert results(out) == {"old.tif"}


def test_records_for_machines(out: Path, shot: Path) -> None:
    outcome = run("render", shot, "-o", out, "--json")
    (record,) = outcome.records
    assert record.pop("seconds") >= 0
    solvers = record.pop("solvers")
    assert list(solvers) == ["luminance", "medians", "affinity"]
    assert all(0 < each["iterations"] <= 100 and 0 <= each["residual"] < 1e-2 for each in solvers.values())
    assert record == {
        "source": str(shot),
        "ok": True,
        "output": str(out / f"{STEM}.tif"),
        "width": 48,
        "height": 36,
        "neutral": [1.0, 1.0, 1.0],
        "neutral_estimated": False,
        "learned": "rggb-k6",
    }
    assert f"{STEM}.tif: 48 x 36" in outcome.err
    assert ": luminance " in outcome.err


def test_the_network_can_be_left_out(out: Path, shot: Path) -> None:
    for preset, network in (("best", "rggb-k6"), ("unlearned", None), ("paper", None)):
        (record,) = run("render", shot, "-o", out, "--json", "--overwrite", *MEASURED[2:], "--preset", preset).records
        assert record["learned"] == network
        assert np.array_equal(tifffile.imread(out / f"{STEM}.tif"), render(read_dng(shot), PRESETS[preset]).rgb)


def test_unknown_noise_is_said(out: Path, tmp_path: Path, shot: Path) -> None:
    words, unknown = "the noise level is unknown and ", save(tmp_path / "shot.dng")
    assert words + "estimated from the shot" in run("render", unknown, "-o", out).err
    assert words + "taken as zero" in run("render", unknown, "-o", out, "--preset", "paper", "--overwrite").err
    assert words not in run("render", shot, "-o", out, "--overwrite").err


# --- what is refused ------------------------------------------------------------------------------------------------------------


def flipped(data: bytes, place: int) -> bytes:
    return data[:place] + bytes([data[place] ^ 4]) + data[place + 1 :]


BAD_SHOTS: dict[str, tuple[Callable[[bytes], bytes], str]] = {
    "bit flipped in the samples": (lambda data: flipped(data, data.find(b"\xff\xc3") + 300), "damaged: the samples differ"),
    "text": (lambda _: b"Hello\n", "not a DNG: it does not begin like a TIFF file; give a shot"),
}


@pytest.mark.parametrize("verb", [("render", "-o"), ("inspect",), ("inspect", "--verify")])
@pytest.mark.parametrize("kind", BAD_SHOTS)
def test_a_bad_shot_costs_one_line_and_the_rest_goes_on(
    out: Path, tmp_path: Path, shot: Path, kind: str, verb: tuple[str, ...]
) -> None:
    damage, words = BAD_SHOTS[kind]
    bad = tmp_path / "bad.dng"
    bad.write_bytes(damage(shot.read_bytes()))
    before = bad.read_bytes(), shot.read_bytes()
    outcome = run(*verb, *([out] if "-o" in verb else []), bad, shot, "--json")
    assert_refused(outcome, words, name=str(bad))
    assert [record["ok"] for record in outcome.records] == [False, True]
    assert results(out) == ({f"{STEM}.tif"} if "-o" in verb else set())
    assert (bad.read_bytes(), shot.read_bytes()) == before


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (256, "no sample is above the black level: nothing was exposed"),
        (4000, "every sample is saturated: there is no picture in it; expose less"),
    ],
)
def test_a_frame_without_a_picture_is_refused(out: Path, tmp_path: Path, code: int, words: str) -> None:
    shot = save(tmp_path / "shot.dng", code)
    assert_refused(run("render", shot, "-o", out), words, name=str(shot))
    assert results(out) == set()


def test_a_frame_whose_colour_samples_alone_are_not_saturated_is_a_picture_for_best(out: Path, tmp_path: Path) -> None:
    """`best` takes luminance from them; the published method has none to begin with."""

    clear = CfaPattern.bayer().panchromatic_mask((13, 17))
    shot = save(tmp_path / "shot.dng", np.where(clear, 4000, 2400))
    words = "every panchromatic sample is saturated: there is no picture in it; expose less"
    assert_refused(run("render", shot, "-o", out, "--preset", "paper"), words, name=str(shot))
    assert results(out) == set()
    run("render", shot, "-o", out, "--bits", "32", "--space", "camera", code=0)
    calibration = read_dng(shot).calibration
    light = tifffile.imread(out / "shot.tif").astype(np.float64) @ np.array(calibration.gamma)
    expected = (2400 - calibration.black_level[0]) * calibration.scale().max() * sum(calibration.gamma)
    assert abs(light.mean() / expected - 1) < 0.02
    assert expected > calibration.full_scale


def test_a_frame_with_one_pixel_of_light_is_a_picture(out: Path, tmp_path: Path) -> None:
    for others, one in ((256, 300), (4000, 2000)):
        light = np.full((13, 17), others)
        light[4, 4] = one
        shot = save(tmp_path / f"{one}.dng", light)
        run("render", shot, "-o", out, *MEASURED, code=0)
        assert np.isfinite(tifffile.imread(out / f"{one}.tif")).all()


def test_a_sensor_whose_colours_nobody_knows(out: Path, tmp_path: Path) -> None:
    """Its measurements can be written, its pictures cannot."""
    pattern = CfaPattern.with_block(("VGB", "XWY"), 6)
    calibration = SensorCalibration("VGBXY")
    samples = np.random.default_rng(0).integers(4096, 60000, (12, 18), np.uint16)
    shot = save_mosaic(tmp_path / "five.dng", Mosaic(samples, pattern, calibration))
    assert_refused(run("render", shot, "-o", out), "no colour matrix for the channels VGBXY", name=str(shot))
    assert_refused(run("render", shot, "-o", out, "-f", "dng"), "3 channels", name=str(shot))
    run("render", shot, "-o", out, *MEASURED, code=0)
    assert tifffile.imread(out / "five.tif").shape == (12, 18, 5)
