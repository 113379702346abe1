"""The example of another runtime on the page of the preview: it is run as it stands there."""

import hashlib
import json
import re
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import numpy_helper

from panchroma.device import Preview
from panchroma.device.preview import contract, graph
from panchroma.device.preview.geometry import Geometry
from panchroma.device.preview.graph import build_preview
from panchroma.shared import Camera, CfaPattern, Mosaic, NoiseModel, SensorCalibration, Shading
from panchroma.shared.arrays import FloatArray
from panchroma.shared.colorimetry import SRGB_TO_XYZ
from panchroma.tools.io.display import ColourTransform
from panchroma.tools.simulation.sensor import sample
from tests.data import ROOT
from tests.python import run_python
from tests.reference.compare import assert_close

# --- graph ----------------------------------------------------------------------------------------

DIGEST = "99b52e956b3fac2b00da7f336b9a9f57921a4e486edb8d981b9a567fea581571"
"""Of the graphs of CASES."""
CALIBRATION = SensorCalibration(
    gamma=(0.9, 1.1, 0.8),
    noise=NoiseModel((2e-4,) * 4, (3e-3,) * 4),
    black_level=(200.0, 210.5, 190.0, 205.0),
    white_level=3900,
    camera_to_xyz=SRGB_TO_XYZ,
    neutral=(0.5, 1.2, 0.7),
)
SIX = CfaPattern.with_block(("RGC", "YWM", "GBR"), 8, (3, 6))
SEVEN = CfaPattern.with_block(("GR", "BG", "RG"), 7, (1, 5))
KODAK = CfaPattern.of_letters("WBWG/BWGW/WGWR/GWRW", (1, 2))
CROWDED = CfaPattern.of_letters("RG/BW", (0, 3))
KAIZU = CfaPattern.of_letters("RWGWBW/WRWGWB/GWBWRW/WGWBWR/BWRWGW/WBWRWG", (2, 5))
# a site whose line has its panchromatic pixels far away
FAR = CfaPattern.of_letters("RGBGW/WWWWW/RWGWB/WWWWW/WWWWW")
# panchromatic samples are on one side of most sites
LONE = CfaPattern.of_letters("RGBRG/GBRGB/BRWRG/RGBRG/GBGRB")
FOUR = CfaPattern.of_letters("WCWMW/WWCWY/YWWWW/WMWWW/WWYWK")
FULL = [
    *(CfaPattern.bayer(6), CfaPattern.bayer(4, "GBRG", (3, 1)), CfaPattern.bayer(3)),
    *(SEVEN, SIX, KODAK, CROWDED, FAR, FOUR),
]
CASES = [
    *((pattern, 1) for pattern in FULL),
    *((CfaPattern.bayer(6, "GRBG", (1, 4)), 3), (CfaPattern.bayer(6, origin=(2, 5)), 2)),
    *((CfaPattern.bayer(6), 6), (CfaPattern.bayer(8, origin=(3, 1)), 2), (SIX, 2), (SIX, 4)),
    *((SEVEN, 7), (KODAK, 2), (CROWDED, 4), (FOUR, 5)),
]
"""Patterns and scales."""


def codes(shape: tuple[int, int], seed: int = 0) -> np.ndarray:
    """A smooth scene with an edge and noise, so that every stage has something to do; some black,
    some at the white level.
    """
    rng = np.random.default_rng(seed)
    rows, columns = np.ogrid[: shape[0], : shape[1]]
    light = 900 + 500 * np.sin(rows / 5) + 400 * np.cos(columns / 7) + 1200 * (columns - rows > 3)
    return (light + rng.normal(0, 40, shape)).clip(0, 4095).astype(np.uint16)


def linear(mosaic: Mosaic, scale: int = 1) -> FloatArray:
    preview = Preview(mosaic.pattern, scale, linear=True, threads=1)
    return np.asarray(preview.run(mosaic), np.float32)


@pytest.mark.parametrize("scale", [1, 2, 3, 6])
@pytest.mark.parametrize(
    "pattern", [*(CfaPattern.bayer(6, order, (1, 4)) for order in ("RGGB", "GRBG")), KAIZU]
)
def test_a_flat_scene_comes_back(pattern: CfaPattern, scale: int) -> None:
    colour = np.array([0.31, 0.22, 0.47], np.float32)
    calibration = SensorCalibration(gamma=(0.9, 1.1, 0.8))
    samples = sample(np.full((40, 31, 3), colour), pattern, calibration)
    mosaic = Mosaic(samples, pattern, calibration)
    # rounding to codes, of the sample and of the luminance it is divided by
    step = 2 * float(calibration.scale().max())
    assert_close(linear(mosaic, scale), np.full((40 // scale, 31 // scale, 3), colour), step)


@pytest.mark.parametrize("slope", [(1, 0), (0, 1), (1, -1), (0.5, 1)])
@pytest.mark.parametrize("pattern", [*FULL, KAIZU, LONE])
def test_a_grey_ramp_comes_back(pattern: CfaPattern, slope: tuple[float, float]) -> None:
    """Luminance at colour sites is interpolated so that planes are kept, but for rounded weights."""
    rows, columns = np.mgrid[-30:30, -33:33]
    light = 0.5 + 0.005 * (slope[0] * rows + slope[1] * columns)
    calibration = SensorCalibration.of_bits(16, channels=pattern.channels)
    scene = np.repeat(light[..., None], len(pattern.channels), axis=2).astype(np.float32)
    mosaic = Mosaic(sample(scene, pattern, calibration), pattern, calibration)
    inner = np.s_[18:-18, 18:-18]
    assert_close(linear(mosaic)[inner], scene[inner], 5e-4)


@pytest.mark.parametrize("scale", [1, 2])
def test_the_screen_picture_is_the_scene_units_through_the_colour_transform(scale: int) -> None:
    mosaic = Mosaic(codes((60, 80)), CfaPattern.bayer(4), CALIBRATION)
    shown = np.rint(ColourTransform.to_space(CALIBRATION).apply(linear(mosaic, scale)) * 255)
    picture = Preview(mosaic.pattern, scale).run(mosaic)
    assert picture.dtype == np.uint8
    assert_close(picture, shown, 1)


@pytest.mark.parametrize("scale", [1, 3])
@pytest.mark.parametrize("light", [(4.8, 2.4, 0.96), (0.9, 0.3, 4.0), (3.5, 3.5, 0.2)])
def test_coloured_light_is_white_where_it_saturates(light: tuple[float, ...], scale: int) -> None:
    """Its blocks do not add up to luminance that is cut off, so that a channel came out negative,
    and the light pure yellow.
    """
    pattern, calibration = CfaPattern.bayer(6), SensorCalibration.of_bits(12)
    samples = sample(np.full((60, 60, 3), light, np.float32), pattern, calibration)
    samples = np.minimum(samples, calibration.full_scale)
    assert Preview(pattern, scale).run(Mosaic(samples, pattern, calibration)).min() >= 254


@pytest.mark.parametrize("name", ["black", "scale", "gamma", "noise", "white", "matrix"])
def test_every_element_of_every_input_matters(name: str) -> None:
    preview = Preview(Mosaic(codes((24, 30)), CfaPattern.bayer(), CALIBRATION).pattern, threads=1)
    inputs = preview._inputs(CALIBRATION) | {contract.MOSAIC: codes((48, 54))}
    inputs[contract.GAIN] = np.ones((1, 1), np.float32)
    before = preview._session.run(None, inputs)[0]
    for place in np.ndindex(inputs[name].shape):
        values = inputs[name].copy()
        values[place] = values[place] * 1.5 + 0.01
        after = preview._session.run(None, {**inputs, name: values})[0]
        assert not np.array_equal(after, before), place


def test_the_gain_around_every_patch_says_when_it_is_burnt_out() -> None:
    pattern = CfaPattern.bayer()
    preview, (above, below, left, right) = Preview(pattern, threads=1), Geometry(pattern).halo
    inputs = {**preview._inputs(CALIBRATION), contract.MOSAIC: np.full((96, 120), 2400, np.uint16)}
    patches = (96 - above - below) // 6, (120 - left - right) // 6
    gain = np.ones(np.add(patches, (3, 5)), np.float32)
    before = preview._session.run(None, {**inputs, contract.GAIN: gain})[0]
    single = preview._session.run(None, {**inputs, contract.GAIN: gain[:1, :1]})[0]
    assert np.array_equal(single, before)
    for row, column in [(0, 0), (5, 7), np.subtract(patches, 1).tolist()]:
        burnt = gain.copy()
        burnt[row + 1 : row + 3, column + 2 : column + 4] = 0.5
        after = preview._session.run(None, {**inputs, contract.GAIN: burnt})[0]
        patch = np.s_[6 * row : 6 * row + 6, 6 * column : 6 * column + 6]
        assert (after[patch] == 255).all()
        assert not (before[patch] == 255).all()
        near = np.s_[max(6 * row - 12, 0) : 6 * row + 18, max(6 * column - 18, 0) : 6 * column + 24]
        after[near] = before[near]  # blocks are pooled
        assert np.array_equal(after, before)


@pytest.mark.parametrize(("pattern", "scale"), CASES)
@pytest.mark.parametrize("linear", [False, True])
def test_noise_is_that_before_the_gain(pattern: CfaPattern, scale: int, linear: bool) -> None:
    calibration = SensorCalibration.of_bits(12, channels=pattern.channels)
    preview = Preview(pattern, scale, linear=linear, threads=1)
    above, below, left, right = Geometry(pattern, scale).halo
    shape = above + 5 * pattern.period + below, left + 6 * pattern.period + right
    dark = np.random.default_rng(0).integers(250, 900, shape)  # far below full scale
    inputs = preview._inputs(calibration)
    inputs[contract.MOSAIC] = dark.astype(np.uint16 if scale == 1 else np.float32)
    if not linear:
        inputs[contract.MATRIX] = np.eye(3, len(pattern.channels), dtype=np.float32)

    def picture(shot: float, read: float, gain: float) -> np.ndarray:
        noise = np.array([shot, read**2], np.float32)
        gains = np.full((1, 1), gain, np.float32)
        return preview._session.run(None, inputs | {contract.NOISE: noise, contract.GAIN: gains})[0]

    assert np.array_equal(picture(1 / 64, 1 / 128, 4.0), picture(1 / 16, 1 / 32, 1.0))
    assert not np.array_equal(picture(1 / 64, 1 / 128, 4.0), picture(1 / 64, 1 / 128, 1.0))


def test_the_same_bytes_every_time() -> None:
    """If the digest fails: another BUILDER, and another digest."""
    built = [build_preview(*case, linear=linear) for case, linear in product(CASES, (False, True))]
    assert built[0] == build_preview(*CASES[0])
    assert hashlib.sha256(b"".join(built)).hexdigest() == DIGEST


def test_versions_and_description() -> None:
    model = onnx.load_from_string(build_preview(CfaPattern.bayer(6), 3))
    assert [(each.domain, each.version) for each in model.opset_import] == [("", 17)]
    assert model.ir_version == 8
    assert model.producer_version == graph.BUILDER
    assert {each.key: each.value for each in model.metadata_props} == {
        "panchroma.contract": contract.VERSION,
        "panchroma.builder": graph.BUILDER,
        "panchroma.tile": "BWWWWG/WWWWWW/WWWWWW/WWWWWW/WWWWWW/GWWWWR",
        "panchroma.channels": "RGB",
        "panchroma.scale": "3",
        "panchroma.output": "display",
        "panchroma.halo": "9 9 15 15",
    }


EXACT = {
    # each rounds once
    *("Add", "Sub", "Mul", "Div", "Sqrt", "Relu", "Max", "Min", "Clip", "QuantizeLinear", "Cast"),
    *("Slice", "Split", "Concat", "Reshape", "Transpose", "Squeeze", "Unsqueeze", "Gather"),
    *("ScatterND", "Identity", "Shape", "Expand"),
}


@pytest.mark.parametrize(("pattern", "scale"), CASES)
def test_other_programs_can_read_it_and_nothing_in_it_depends_on_the_processor(
    pattern: CfaPattern, scale: int
) -> None:
    """But for the colour matrix, convolutions add 16-bit codes times small multiples of 1/64: exact
    in single precision.
    """
    graphs = (build_preview(pattern, scale, linear=linear) for linear in (True, False))
    light, model = map(onnx.load_from_string, graphs)
    for each in (light, model):
        onnx.checker.check_model(each, full_check=True)
    assert {node.op_type for node in model.graph.node} <= {*EXACT, "Conv"}
    constants = model.graph.initializer
    weights = {each.name: numpy_helper.to_array(each).astype(float) for each in constants}
    made = {node.output[0]: node for node in model.graph.node}
    kernels = [node.input[1] for node in model.graph.node if node.op_type == "Conv"]
    assert {made[name].input[0] for name in kernels if name not in weights} == {contract.MATRIX}
    for kernel in (weights[name] for name in kernels if name in weights):
        for sums in kernel:
            unit = 1 if np.array_equal(sums, np.rint(sums)) else 64
            assert np.array_equal(sums * unit, np.rint(sums * unit))
            assert np.abs(sums * unit).sum() * 65535 < 2**24


# --- contract -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("pattern", "scale"),
    [
        (CfaPattern.bayer(6, "GRBG", origin=(0, 5)), 1),
        (CfaPattern.bayer(6, origin=(4, 1)), 2),
        (CfaPattern.bayer(6, "BGGR", origin=(3, 2)), 3),
        (CfaPattern.of_letters("WBWG/BWGW/WGWR/GWRW", (1, 2)), 2),
    ],
)
@pytest.mark.parametrize(
    ("shape", "points"),
    [((61, 83), None), ((61, 83), (9, 5)), ((60, 84), (4, 6)), ((17, 100), (5, 13))],
)
def test_the_example_gives_the_bytes_of_the_preview(
    tmp_path: Path,
    pattern: CfaPattern,
    scale: int,
    shape: tuple[int, int],
    points: tuple[int, int] | None,
) -> None:
    """Without shading, or with that of a lens in any number of control points."""
    tinted = tuple(tuple(0.8 * value + 0.03 for value in row) for row in SRGB_TO_XYZ)
    calibration = replace(CALIBRATION, camera_to_xyz=tinted)
    if points:
        # odd, so that the middle has the gain 1
        slopes = np.add.outer(*(np.linspace(-0.8, 0.8, number) ** 3 for number in points))
        gains = 1 + np.array([0.5, 0.4, 0.3, 0.4])[:, None, None] * slopes
        calibration = replace(calibration, shading=Shading(gains.tolist(), shape))
    codes = np.random.default_rng(scale).integers(200, 4096, shape).astype(np.uint16)
    mosaic = Mosaic(codes, pattern, calibration)
    (tmp_path / "preview.onnx").write_bytes(build_preview(pattern, scale))
    (tmp_path / "camera.json").write_text(json.dumps(Camera(calibration, pattern).to_json()))
    np.save(tmp_path / "codes.npy", codes)
    page = (ROOT / "device" / "preview" / "README.md").read_text("utf-8")
    (example,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    run_python(example + 'np.save("picture.npy", picture)', folder=tmp_path)
    picture = np.load(tmp_path / "picture.npy")
    expected = Preview(pattern, scale, threads=1).run(mosaic)
    assert (picture.dtype, picture.shape) == (np.uint8, (shape[0] // scale, shape[1] // scale, 3))
    assert np.array_equal(picture, expected)
