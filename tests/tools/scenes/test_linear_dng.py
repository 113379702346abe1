"""Linear DNGs as scenes: those of `panchroma render`, and what other programs may write."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shared.colorimetry import D50
from tests.tools.scenes.files import ASCII, LINEAR_RAW, LONG, RATIONAL, SHORT, SRATIONAL, Fields, rationals, write_dng
from tools.scenes.load import load_scene

SHAPE = (40, 52, 3)
NEUTRAL = (0.5, 1.0, 0.625)
LOSSLESS = {"lossless": True, "predictor": 1, "bitspersample": 16}
CAMERA: Fields = {
    50721: (SRATIONAL, rationals(((0.8, -0.2, -0.1), (-0.4, 1.2, 0.2), (-0.1, 0.2, 0.6)))),
    50778: (SHORT, [21]),
    50728: (RATIONAL, rationals(NEUTRAL)),
    274: (SHORT, [6]),
    271: (ASCII, "Contax"),
}


def codes(dtype: Any = np.uint16, seed: int = 0) -> Any:
    values = np.random.default_rng(seed).integers(0, 60000, SHAPE)
    return values.astype(dtype) if np.dtype(dtype).kind == "u" else (values / 65536).astype(dtype)


def save(path: Path, samples: Any, fields: Fields | None = None, *, below: bool = True, **options: Any) -> str:
    """A linear DNG, its samples in the first directory or below it; fields: of the samples' directory."""
    where: Any = {"fields": fields, "above": CAMERA} if below else {"fields": {**CAMERA, **(fields or {})}}
    return write_dng(path, samples, kind=LINEAR_RAW, **where, **options)


@pytest.mark.parametrize("below", [True, False])
@pytest.mark.parametrize(
    ("dtype", "options"),
    [
        (np.uint16, {}),
        (np.uint16, {"tile": (16, 32)}),
        (np.uint16, {"rowsperstrip": 7}),
        (np.uint16, {"compression": "deflate", "rowsperstrip": 16}),
        (np.uint16, {"compression": "deflate", "predictor": True, "tile": (32, 16)}),
        (np.uint16, {"compression": "jpeg", "compressionargs": LOSSLESS, "tile": (32, 16), "bitspersample": 16}),
        (np.float32, {}),
        (np.float32, {"compression": "deflate", "predictor": True, "tile": (16, 16)}),
        (np.float16, {"compression": "deflate", "predictor": True}),
    ],
)
def test_samples_of_every_lossless_kind(tmp_path: Path, dtype: Any, options: dict[str, Any], below: bool) -> None:
    samples = codes(dtype)
    scene = load_scene(save(tmp_path / "x.dng", samples, below=below, **options))
    np.testing.assert_allclose(scene.rgb, samples.astype(np.float64) / (65535 if samples.dtype.kind == "u" else 1), atol=1e-6)
    assert scene.neutral == pytest.approx(NEUTRAL)
    assert not scene.neutral_estimated
    np.testing.assert_allclose(np.array(scene.camera_to_xyz) @ NEUTRAL, D50, atol=1e-4)
    assert (scene.metadata.orientation, scene.metadata.make) == (6, "Contax")


def test_levels_table_and_active_area(tmp_path: Path) -> None:
    samples = np.minimum(codes(), 38000)  # nothing is clipped
    black = np.array([[[100, 200, 300], [110, 210, 310]]])
    fields: Fields = {
        50713: (SHORT, (1, 2)),
        50714: (RATIONAL, rationals(black)),
        50715: (SRATIONAL, rationals(np.arange(48) / 4)),
        50717: (LONG, (60000, 50000, 40000)),
        50829: (LONG, (2, 3, 38, 51)),
    }
    path = save(tmp_path / "x.dng", samples, fields)
    levels = np.tile(black, (36, 24, 1)) + np.arange(48)[None, :, None] / 4
    expected = (samples[2:38, 3:51] - levels) / (np.array((60000, 50000, 40000)) - levels.max(axis=(0, 1)))
    np.testing.assert_allclose(load_scene(path).rgb, expected.clip(0), atol=1e-5)
    table = np.linspace(0, 65535, 4096).astype(int)
    short = np.random.default_rng(0).integers(0, 4000, SHAPE).astype(np.uint16)
    path = save(tmp_path / "y.dng", short, {50712: (SHORT, table.tolist()), 50717: (SHORT, [65535])})
    np.testing.assert_allclose(load_scene(path).rgb, table[short] / 65535, atol=1e-6)


def test_without_a_neutral_it_is_estimated_and_marked(tmp_path: Path) -> None:
    samples = (codes() * np.array(NEUTRAL)).astype(np.uint16)
    scene = load_scene(write_dng(tmp_path / "x.dng", samples, kind=LINEAR_RAW))
    assert scene.neutral_estimated
    assert scene.neutral == pytest.approx(NEUTRAL, abs=0.05)
    assert "is estimated from the scene" in scene.notes[0]
