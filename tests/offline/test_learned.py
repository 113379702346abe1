"""The network's surroundings: superpixels, mirror images, chunks, bounds. How good its corrections
are is told by the evaluation.
"""

from dataclasses import replace
from math import isqrt
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from scipy.ndimage import maximum_filter, uniform_filter

from panchroma.offline import BEST, memory, network_name, render, rendering_memory
from panchroma.offline.bands import Band
from panchroma.offline.frame import Frame
from panchroma.offline.settings import RenderSettings
from panchroma.offline.stages import colour_network as module
from panchroma.offline.stages.colour_network import REACH, ColourNetwork
from panchroma.offline.stages.correction import SiteResidual
from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
from panchroma.shared.arrays import FloatArray
from panchroma.shared.errors import InputError
from panchroma.shared.networks import NETWORKS, Block, load_network, network_for
from panchroma.shared.pattern import MIRRORS
from panchroma.shared.runtime import onnxruntime, session
from tests.offline.scenes import photographed, sampled
from tests.reference.compare import assert_close
from tests.scenes import leaves

WITHOUT = replace(BEST, learned=replace(BEST.learned, used=False))
ONES = np.ones(3, np.float32)
TILES = [
    CfaPattern.bayer(4, origin=(3, 1)),
    CfaPattern.bayer(5, origin=(1, 4)),
    CfaPattern.bayer(6, origin=(4, 5)),
    CfaPattern.bayer(8, origin=(2, 3)),
    CfaPattern.with_block(("RG", "BW"), 4, (1, 2)),
    CfaPattern.of_letters("kodak"),
]
# mirror images of these are the same tile, which begins elsewhere
SYMMETRIC = [CfaPattern.of_letters("kaizu"), CfaPattern.of_letters("rccb")]
LEAVES = leaves(220, 330)
# The same sums in another order, where a tile begins elsewhere.
FLOAT32 = 2e-5


def scene(height: int, width: int) -> FloatArray:
    """The upper left corner of a scene of leaves."""
    return LEAVES[:height, :width]


def measured(rgb: FloatArray, pattern: CfaPattern, sigma: float = 0.0) -> tuple[Band, Frame]:
    """A picture that is blurred in colour, and what the sites measured."""
    mosaic = photographed(rgb, pattern, sigma)
    light = np.ascontiguousarray(rgb.sum(axis=2))
    grey = np.full(rgb.shape, 1 / 3, np.float32)
    colour = (rgb / light[..., None] * np.float32(0.7) + grey * np.float32(0.3)).astype(np.float32)
    samples = sampled(mosaic, light)
    return SiteResidual(samples)(Band(0, light, colour), (0, len(light))), samples


def learned(pattern: CfaPattern, frame: Frame) -> ColourNetwork:
    """The network for a pattern as a stage."""
    return ColourNetwork(network_for(pattern), frame)


def refined(rgb: FloatArray, pattern: CfaPattern) -> FloatArray:
    """Chromaticity after the network."""
    band, sites = measured(rgb, pattern)
    return learned(pattern, sites)(band, (0, len(rgb))).chromaticity


def error(mosaic: Mosaic, rgb: FloatArray, settings: RenderSettings) -> float:
    return float(np.square(render(mosaic, settings).rgb - rgb)[15:-15, 15:-15].mean())


def blocks_of(period: int, *letters: str) -> list[CfaPattern]:
    """Patterns with blocks whose rows are separated by "/"."""
    return [CfaPattern.with_block(tuple(each.split("/")), period) for each in letters]


NAMED = pytest.mark.parametrize(
    "path", sorted(NETWORKS.glob("*-k*.onnx")), ids=lambda path: path.stem
)


@NAMED
def test_a_network_serves_a_block_and_its_mirror_images(path: Path) -> None:
    letters, _, period = path.stem.upper().partition("-K")
    side = isqrt(len(letters))
    rows = [letters[start : start + side] for start in range(0, len(letters), side)]
    for down, across in MIRRORS:
        block = tuple(row[::across] for row in rows[::down])
        whole = side == int(period)
        pattern = CfaPattern(block) if whole else CfaPattern.with_block(block, int(period))
        assert network_name(pattern) == path.stem


def test_a_tile_has_its_network_wherever_its_letters_begin() -> None:
    for pattern in (*map(CfaPattern.of_letters, ("SCF1WGWB", "sony", "honda")), *SYMMETRIC):
        letters = "/".join(pattern.letters_from((1, 2)))
        other = CfaPattern.of_letters(letters, (1, 2))
        assert other.tile != pattern.tile
        assert network_name(other) == network_name(pattern) is not None
        for down, across in MIRRORS:
            image = tuple(row[::across] for row in other.tile[::down])
            assert network_name(CfaPattern(image)) == network_name(pattern)
        if pattern.name == "Kodak":  # the others may begin at several places
            mosaic = photographed(scene(60, 70), pattern)
            again = render(replace(mosaic, pattern=other))
            assert np.array_equal(again.rgb, render(mosaic).rgb)


def test_other_blocks_have_no_network() -> None:
    others = [*blocks_of(7, "RG/GB"), *blocks_of(6, "RG/WB", "RGB", "RGGB"), *blocks_of(4, "RB/GW")]
    assert not any(map(network_name, others))


@pytest.mark.parametrize("axes", [(1,), (0,), (0, 1)])
@pytest.mark.parametrize("pattern", TILES, ids=network_name)
def test_the_other_orders_are_mirror_images(pattern: CfaPattern, axes: tuple[int, ...]) -> None:
    rgb = scene(16 * pattern.period, 18 * pattern.period)
    letters = np.flip(np.array([list(row) for row in pattern.letters_from()]), axes)
    image = CfaPattern(tuple("".join(row) for row in letters.tolist()))
    if image.is_scattered and any(image.block_origin):
        pytest.skip("it is the same tile, which begins elsewhere")
    found = refined(np.ascontiguousarray(np.flip(rgb, axes)), image)
    assert_close(found, np.flip(refined(rgb, pattern), axes), FLOAT32)


@pytest.mark.parametrize("pattern", [*TILES, *SYMMETRIC], ids=network_name)
def test_luminance_stays_but_at_the_sites(pattern: CfaPattern) -> None:
    band, samples = measured(scene(20 * pattern.period, 22 * pattern.period), pattern)
    found = learned(pattern, samples)(band, (0, len(band.luminance)))
    changed = found.luminance != band.luminance
    assert not changed[pattern.panchromatic_mask(changed.shape)].any()
    assert changed[~pattern.panchromatic_mask(changed.shape)].mean() > 0.4
    assert_close(found.chromaticity.sum(axis=2), np.ones(changed.shape), 1e-5)


def test_what_luminance_gains_at_a_site_is_grey() -> None:
    pattern, level = CfaPattern.of_letters("rccb"), np.float32(0.6)
    luminance = np.full((8, 8), level)
    chromaticity = np.tile(np.array([0.5, 0.3, 0.2], np.float32), (8, 8, 1))
    sites, light = Block.of(pattern).sites(4), np.zeros((8, 2, 2), np.float32)
    light[3, 1, 0] = 0.5  # of the bound
    numbers = np.full(16, -1)
    numbers[sites] = np.arange(8)
    blank = np.zeros((2, 16, 2, 2), np.float32)
    far = np.full((2, 2, 2), 9, np.float32)
    bound, dim = np.full((2, 2), 0.04, np.float32), np.full((2, 2), 0.1, np.float32)
    answer = module.Answer(blank, bound, dim, -far, far)
    places = np.arange(8), np.arange(8)
    colour = chromaticity.copy()
    module.add_answer(answer, light, numbers, module.BASIS, ONES, places, luminance, colour)
    row, column = 4 + sites[3] // 4, sites[3] % 4
    rgb = colour * luminance[..., None] - chromaticity * level
    assert rgb[row, column] == pytest.approx(0.02, rel=1e-4)
    rgb[row, column] = 0
    assert np.abs(rgb).max() < 1e-6


@pytest.mark.parametrize("colour", [(1.0, 1.0, 1.0), (1.0, 0.5, 0.2), (0.05, 0.1, 0.9)])
def test_one_colour_stays_that_colour(colour: tuple[float, ...]) -> None:
    """A ramp of light over a surface of one colour, grey or another: 16 bits hold no smaller
    difference than one in 65,536.
    """
    light = np.broadcast_to(np.linspace(0.05, 0.9, 180)[None, :, None], (150, 180, 1))
    rgb = (light * np.array(colour)).astype(np.float32)
    mosaic = photographed(rgb)
    change = render(mosaic).rgb - render(mosaic, WITHOUT).rgb
    assert np.abs(change[20:-20, 20:-20]).max() < 1 / 65536


def test_noise_on_a_flat_surface_is_not_taken_for_colour() -> None:
    rgb = np.full((200, 210, 3), 0.3, np.float32)
    mosaic = photographed(rgb, sigma=0.01)
    assert error(mosaic, rgb, BEST) < 1.02 * error(mosaic, rgb, WITHOUT)


def test_gamma_only_scales_the_channels() -> None:
    rgb, pattern, gamma = scene(100, 100), CfaPattern.bayer(6), (0.5, 1.0, 2.0)
    scaled = np.array(gamma, np.float32)
    band, sites = measured(rgb, pattern)
    other = replace(band, chromaticity=band.chromaticity / scaled)
    signal = sites.signal.copy()
    for channel, place in zip(sites.sites.channels, sites.sites.places, strict=True):
        signal[place] /= scaled[channel]
    seen = replace(sites, mosaic=Mosaic(signal, pattern, SensorCalibration(gamma=gamma)))
    expected = learned(pattern, sites)(band, (0, 100)).chromaticity
    found = learned(pattern, seen)(other, (0, 100)).chromaticity
    assert_close(found * scaled, expected, 1e-5)


def test_it_brings_colour_closer_to_the_scene() -> None:
    rgb = leaves(240, 360)
    mosaic = photographed(rgb)
    assert error(mosaic, rgb, BEST) < 0.91 * error(mosaic, rgb, WITHOUT)


@pytest.mark.parametrize("pattern", TILES, ids=network_name)
@pytest.mark.parametrize("light", [0.0, 0.3, -0.01])
def test_where_nothing_changes_nothing_is_corrected(pattern: CfaPattern, light: float) -> None:
    """Flat to the last bit: there is no activity, and no division by it."""
    rgb = np.full((90, 96, 3), light, np.float32)
    band, sites = measured(np.ones_like(rgb), pattern)
    dim = np.full_like(band.luminance, light)
    flat = replace(band, luminance=dim, residual=np.zeros_like(dim))
    assert_close(learned(pattern, sites)(flat, (0, 90)).chromaticity, band.chromaticity, 1e-6)


def test_the_network_runs_only_where_it_corrects_something(monkeypatch: pytest.MonkeyPatch) -> None:
    """A place of colour in a flat frame of 2 x 2 tiles."""
    rgb = np.full((330, 340, 3), 0.3, np.float32)
    rgb[100:150, 90:100] = 0.9, 0.1, 0.2
    pattern, asked = CfaPattern.bayer(6, "GRBG", origin=(1, 4)), list[tuple[int, ...]]()
    band, samples = measured(rgb, pattern)
    stage = learned(pattern, samples)
    network = load_network(stage.path)

    class Counted:
        def run(self, names: None, inputs: dict[str, FloatArray]) -> list[FloatArray]:
            asked.append(inputs["features"].shape[2:])
            return network.run(names, inputs)

    monkeypatch.setattr(module, "load_network", lambda _: Counted())
    changed = np.abs(stage(band, (0, 330)).chromaticity - band.chromaticity).max(axis=2) > 0
    assert len(asked) == 1
    assert max(asked[0]) < 30
    assert changed[100:150].any()
    assert not changed[200:].any()


def test_no_channel_gains_or_loses_more_than_all_light() -> None:
    """Among pixels below black, the contrast that bounds corrections is without bounds itself."""
    pattern, random = CfaPattern.bayer(6), np.random.default_rng(0)
    dark = random.uniform(-1, 0.5, (66, 78, 3)).astype(np.float32) * 30
    mosaic = photographed(dark, pattern)
    found, plain = render(mosaic, BEST), render(mosaic, WITHOUT)
    change, light = np.abs(found.rgb - plain.rgb).max(axis=2), np.maximum(plain.luminance, 0)
    seen = pattern.panchromatic_mask(light.shape)
    assert (change[seen] <= 1.001 * light[seen] + 1e-3).all()
    around = maximum_filter(uniform_filter(light, 6), 7)
    assert (change <= 1.4 * light + around + 1e-3).all()


def test_a_damaged_file_is_named(tmp_path: Path) -> None:
    path = tmp_path / "rggb-k6.onnx"
    path.write_bytes(b"nothing")
    words = r"rggb-k6\.onnx: is not a network that onnxruntime can run"
    with pytest.raises(InputError, match=words):
        load_network(path)


@pytest.mark.parametrize("words", ["std::bad_alloc", "bad allocation", "Failed to allocate memory"])
def test_without_memory_no_file_is_called_damaged(
    words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    none_left = Mock(side_effect=RuntimeError(words))
    monkeypatch.setattr(onnxruntime, "InferenceSession", none_left)
    with pytest.raises(MemoryError):
        session(b"")


def test_a_memory_estimate_reads_no_network(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    damaged = tmp_path / "rggb-k6.onnx"
    damaged.write_bytes(b"nothing")
    monkeypatch.setattr(memory, "network_for", lambda _: damaged)
    mosaic = Mosaic(np.zeros((600, 900), np.uint16), CfaPattern.bayer(6), SensorCalibration())
    assert rendering_memory(mosaic, BEST) > rendering_memory(mosaic, WITHOUT) + 90e6


@NAMED
def test_every_network_sees_as_far_as_the_stage_looks(path: Path) -> None:
    network = load_network(path)
    side, (inputs,) = 2 * REACH + 3, network.get_inputs()
    features = np.zeros((1, inputs.shape[1], side, side), np.float32)
    (answer,) = network.run(None, {"features": features})
    assert answer.shape[2:] == (3, 3)


@pytest.mark.parametrize("path", sorted(NETWORKS.glob("*k*.onnx")), ids=lambda path: path.stem)
def test_convolutions_compute_with_integers(path: Path, tmp_path: Path) -> None:
    """The file says so by pairs of roundings, which onnxruntime has to recognise: four blocks of
    two, twice if it looks twice.

    Then the first convolution rounds as well. The last one never does. Three sites look the same in
    one orientation only. Of the network of blocks all but the first and the last round.
    """
    remedy = "pip install -e '.[all,dev]'"
    onnx = pytest.importorskip("onnx", reason=f"files of networks: onnx is not installed: {remedy}")
    options = onnxruntime.SessionOptions()
    options.optimized_model_filepath = str(tmp_path / path.name)
    options.log_severity_level = 3  # such a file is for this processor alone
    onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    kinds = [node.op_type for node in onnx.load(tmp_path / path.name).graph.node]
    rounding = {"blocks": 22, "rgbw-k4": 8}.get(path.stem, 18)
    assert kinds.count("QLinearConv") == rounding
    assert kinds.count("Conv") + kinds.count("FusedConv") == 2
