"""Print: black type stays black, white type on dark white, and coloured type keeps colour, whatever
the font, the size, the pattern and the noise. The networks have seen the first three fonts alone.
"""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import maximum_filter

from panchroma.offline import BEST, Rendering, render
from panchroma.shared import CfaPattern
from panchroma.shared.arrays import FloatArray
from tests.offline.scenes import photographed

matplotlib = pytest.importorskip("matplotlib", reason="print: pip install -e '.[all,dev]'")

FONTS = "DejaVuSans", "DejaVuSerif", "DejaVuSansMono", "cmb10", "cmmi10"
SIZES = 8, 11, 14, 19, 26
PATTERNS = "K=4", "K=5", "K=6", "K=8", "RGWW/BWWW/WWWW/WWWW", "kodak"
NOISES = 0.0, 0.01, 0.03
BLACK, WHITE, RED, BLUE = (0.02,) * 3, (0.8,) * 3, (0.5, 0.05, 0.05), (0.05, 0.08, 0.45)
WORDS = "Vow to judge my black sphinx of quartz 1986 hymn"
_FINE = 4  # samples per pixel and axis


@cache
def page(inks: tuple[tuple[float, ...], ...], paper: tuple[float, ...]) -> FloatArray:
    """Lines of every font in every size, float32 (H, W, 3), scene units; words have the inks in
    turn.
    """
    from PIL import Image, ImageDraw, ImageFont

    folder = Path(matplotlib.get_data_path(), "fonts", "ttf")
    height, width = int(len(FONTS) * sum(SIZES) * 1.4), 260
    sheets = [Image.new("L", (width * _FINE, height * _FINE)) for _ in inks]
    pens, top = [ImageDraw.Draw(sheet) for sheet in sheets], 0.0
    for size in SIZES:
        for name in FONTS:
            font = ImageFont.truetype(str(folder / f"{name}.ttf"), size * _FINE)
            left = 3.7 * _FINE
            for number, word in enumerate(WORDS.split()):
                pens[number % len(pens)].text((left, top), word, fill=255, font=font)
                left += font.getlength(word + " ")
            top += 1.4 * size * _FINE
    scene = np.full((height, width, 3), paper, np.float64)
    for sheet, ink in zip(sheets, inks, strict=True):
        fine = np.asarray(sheet, np.float64).reshape(height, _FINE, width, _FINE) / 255
        covered = fine.mean(axis=(1, 3))[..., None]
        scene = scene * (1 - covered) + covered * np.array(ink)
    return scene.astype(np.float32)


def rendered(scene: FloatArray, letters: str, sigma: float) -> Rendering:
    return render(photographed(scene, CfaPattern.of_letters(letters), sigma), BEST)


def tints(rgb: FloatArray) -> FloatArray:
    """The channels less their mean, (H, W, 3), scene units, without the edges of the frame."""
    return (rgb - rgb.mean(axis=2, keepdims=True))[12:-12, 12:-12]


@pytest.mark.parametrize("sigma", NOISES)
@pytest.mark.parametrize("letters", PATTERNS)
@pytest.mark.parametrize(("ink", "paper"), [(BLACK, WHITE), (WHITE, BLACK)], ids=["black", "white"])
def test_type_without_colour_gets_none(
    ink: tuple[float, ...], paper: tuple[float, ...], letters: str, sigma: float
) -> None:
    found = np.abs(tints(rendered(page((ink,), paper), letters, sigma).rgb)).max(axis=2)
    assert np.quantile(found, 0.999) < (0.06 if ink == BLACK else 0.15)
    assert ink == WHITE or found.max() < 0.3


@pytest.mark.parametrize("sigma", NOISES)
@pytest.mark.parametrize("letters", PATTERNS)
def test_coloured_type_keeps_its_colour(letters: str, sigma: float) -> None:
    scene = page((BLACK, RED, BLUE), WHITE)
    found, colour = tints(rendered(scene, letters, sigma).rgb), tints(scene)
    share = (found * colour).sum() / np.square(colour).sum()
    assert share > (0.36 if letters == "K=8" else 0.5 if sigma == NOISES[-1] else 0.54)


@pytest.mark.parametrize("letters", PATTERNS)
def test_dark_ground_beside_white_type_has_no_specks(letters: str) -> None:
    """Where it is even, colour sites are as quiet as other pixels, but for a few near strokes."""
    scene = page((WHITE,), BLACK)
    error = rendered(scene, letters, 0.01).luminance - scene.sum(axis=2)
    even = maximum_filter(scene.max(axis=2), 9) < 0.03
    clear = CfaPattern.of_letters(letters).panchromatic_mask(error.shape)
    assert error[even & ~clear].std() < 5 * error[even & clear].std()
