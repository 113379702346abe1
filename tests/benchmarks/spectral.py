"""The spectral scene: the built-in scene with known spectra, in eight bands, for cameras with other filters than R, G and B.

Photographs have three channels, so that they cannot tell what a fourth filter would have seen. Here every surface has a reflectance
in eight narrow bands, and every value is illuminant times reflectance. Bands are triangles over wavelength that add up to an even
response from 420 to 665 nm: a panchromatic pixel reads their sum.
"""

from types import MappingProxyType

import numpy as np

from panchroma.shared.arrays import BoolArray, DoubleArray
from panchroma.shared.colorimetry import D50
from panchroma.shared.lights import illuminant_xy, temperature
from panchroma.tools.io.scene import Scene
from panchroma.tools.simulation.drawn.builtin import Drawing, leaves_and_charts
from panchroma.tools.simulation.drawn.charts import Paints, colour_star, detail_chart, ink, patches_chart
from panchroma.tools.simulation.drawn.dead_leaves import Materials

BANDS = "HIJKLNOP"  # short to long wavelengths; letters that no other filter has
CENTRES = np.arange(420.0, 666.0, 35.0)  # nm; each band fades to nothing at the centres of its neighbours
TEMPERATURE = 5000.0  # K, of the usual light: Planck's formula
_SECOND_RADIATION = 1.438777e7  # nm K, hc / k

# Reflectances of the ColorChecker in thousandths, in reading order: N. Ohta's measurements (1997), which colour-science 0.4.7
# republishes ("ColorChecker N Ohta"), averaged over each band.
_PATCHES = (
    (62, 54, 58, 71, 91, 131, 165, 214), (199, 236, 291, 307, 310, 451, 561, 619), (318, 323, 276, 219, 182, 154, 130, 111),
    (51, 59, 77, 151, 143, 110, 98, 109), (417, 424, 360, 259, 205, 226, 263, 407), (313, 403, 544, 551, 434, 288, 218, 219),
    (53, 52, 59, 116, 304, 505, 576, 606), (313, 363, 252, 134, 92, 85, 93, 119), (137, 128, 111, 95, 117, 341, 576, 605),
    (188, 134, 78, 57, 54, 62, 124, 209), (63, 86, 213, 475, 506, 399, 329, 335), (64, 71, 110, 252, 496, 611, 653, 677),
    (210, 306, 183, 66, 44, 40, 41, 43), (60, 78, 153, 313, 278, 148, 86, 77), (50, 48, 45, 44, 55, 189, 554, 700),
    (53, 65, 219, 497, 656, 728, 761, 780), (332, 282, 187, 121, 114, 262, 598, 766), (257, 372, 435, 310, 152, 86, 74, 75),
    (746, 885, 888, 887, 887, 887, 890, 889), (534, 586, 581, 582, 585, 587, 582, 575), (342, 360, 357, 357, 359, 360, 355, 348),
    (198, 204, 202, 202, 203, 204, 201, 197), (93, 94, 93, 93, 93, 92, 90, 88), (36, 35, 34, 34, 33, 33, 33, 33),
)  # fmt: skip
PATCHES = np.array(_PATCHES) / 1000
_DARK_SKIN, _LIGHT_SKIN, _FOLIAGE, _ORANGE, _BLUE, _RED, _CYAN, _WHITE, _GREY, _BLACK = PATCHES[
    [0, 1, 3, 6, 12, 14, 17, 18, 20, 23]
]
# Leaves are made of all patches but the darkest, mostly of those that imitate nature (the first row), and of greys. A leaf has
# somewhat more or less of the dyes of the third row than others of its kind: dyes multiply (Beer and Lambert).
_FREQUENCY = np.repeat((4.0, 1.0, 0.5, 2.0), 6)[:23]
_DYES = 0.15 * np.log(PATCHES[12:18] / _WHITE)

# Broad red, green and blue filters, in 24ths of what a panchromatic pixel sees of a band. In each band they add up to all of it,
# and each collects 64 / 24 bands of light, so that gamma is (1, 1, 1).
_BLUE_FILTER = np.array((21, 20, 13, 5, 2, 1, 1, 1))
_RED_FILTER = _BLUE_FILTER[::-1]
_FILTERS = {"R": _RED_FILTER, "G": 24 - _RED_FILTER - _BLUE_FILTER, "B": _BLUE_FILTER}
_FILTERS |= {name: _FILTERS[first] + _FILTERS[second] for name, first, second in ("CGB", "MRB", "YRG")}
MIXTURES = MappingProxyType({name: tuple((passed / 24).tolist()) for name, passed in _FILTERS.items()})
"""What other filters let through of the bands: R, G and B, and C, M and Y, which pass what two of these pass; 0 to 1."""

_STRIPES = (0.10, 0.05, 0.02)  # widths in the metamer chart, parts of its height


def spectral_scene(width: int, height: int, illuminant: str = "") -> Scene:
    """Draw the scene at any size from 1 x 1, in eight bands; the same size gives the same pixels.

    illuminant: the light, see `shared.lights.illuminant_xy`: a black body as warm; "" = 5000 K, under which metamers look alike.

    It shows dead leaves as `builtin_scene` does, and in larger frames charts in front of them: a ColorChecker, metamers, a Siemens
    star in chromaticity alone, and slanted edges with lettering. White reads `light`, 1 in the brightest band.
    """
    ground = 0.4 * _DARK_SKIN
    materials = Materials(PATCHES[:23], _FREQUENCY, _DYES - _DYES.mean(axis=1, keepdims=True), ground)
    picture = leaves_and_charts(width, height, materials, CHARTS, _paints())
    shining = light(temperature(illuminant_xy(illuminant))) if illuminant else light()
    picture *= shining.astype(np.float32)
    name = f"spectral-{width}x{height}{illuminant and '@'}{illuminant}"
    return Scene(picture, name, _to_xyz(shining), tuple(shining.tolist()), channels=BANDS, mixtures=MIXTURES)


def light(kelvin: float = TEMPERATURE) -> DoubleArray:
    """Light of the scene in each band, (8,), 1 in the brightest: what a white surface reads."""
    radiance: DoubleArray = CENTRES**-5 / np.expm1(_SECOND_RADIATION / (CENTRES * kelvin))
    radiance /= radiance.max()
    return radiance


def metamers() -> tuple[tuple[DoubleArray, DoubleArray], ...]:
    """Pairs of reflectances, (8,) each, that R, G and B (so W, C, M and Y too) read alike under this light, and the bands do not.

    They differ by the smoothest spectrum that R, G and B do not see.
    """
    seen = np.array([MIXTURES[name] for name in "RGB"]) * light()
    unseen = np.linalg.svd(seen)[2][3:]
    bends = np.diff(unseen, 2, axis=1)
    difference = np.linalg.eigh(bends @ bends.T)[1][:, 0] @ unseen
    difference *= np.sign(difference[0])
    pairs = []
    for middle in (_GREY, _LIGHT_SKIN, 2 * _FOLIAGE):
        half = difference * np.min((middle - _BLACK) / np.abs(difference))  # as much as leaves both above black
        pairs.append((middle + half, middle - half))
    return tuple(pairs)


def metamer_chart(x: DoubleArray, y: DoubleArray, pixel: float, paints: Paints) -> DoubleArray:
    """Draw metamers: patches side by side, stripes, and lettering, all of which R, G and B see as even surfaces."""
    pairs = metamers()
    pair = np.clip(x * len(pairs), 0, len(pairs) - 1).astype(int)
    section = np.clip(x * len(_STRIPES), 0, len(_STRIPES) - 1).astype(int)
    patches: BoolArray = x * len(pairs) % 1 < 0.5
    stripes: BoolArray = x // np.array(_STRIPES)[section] % 2 < 1
    letters = ink(x - 0.06, y - 0.80, 0.105)
    first = np.where(y < 0.4, patches, np.where(y < 0.7, stripes, letters))
    return np.array(pairs)[np.where(y < 0.4, pair, 0), np.where(first, 0, 1)]


# From left to right: width over height, drawing.
CHARTS: tuple[tuple[float, Drawing], ...] = ((1.5, patches_chart), (1.0, metamer_chart), (1.0, colour_star), (1.0, detail_chart))


def _paints() -> Paints:
    cool = _CYAN * (light() @ _ORANGE) / (light() @ _CYAN)  # as bright as orange to a panchromatic pixel
    return Paints(PATCHES.reshape(4, 6, -1), _WHITE, _BLACK, _ORANGE, cool, (_BLACK, _RED, _BLUE, _BLACK))


def _to_xyz(shining: DoubleArray) -> tuple[tuple[float, ...], ...]:
    """The bands in CIE XYZ, (3, 8), scaled so that the light is D50.

    Colour matching functions: C. Wyman, P.-P. Sloan and P. Shirley, "Simple Analytic Approximations to the CIE XYZ Color Matching
    Functions" (JCGT 2013), the sums of Gaussians.
    """

    def lobe(height: float, peak: float, left: float, right: float) -> DoubleArray:
        away = (CENTRES - peak) * np.where(peak > CENTRES, left, right)
        return height * np.exp(-0.5 * away**2)

    matching = np.stack(
        [
            lobe(0.362, 442.0, 0.0624, 0.0374) + lobe(1.056, 599.8, 0.0264, 0.0323) + lobe(-0.065, 501.1, 0.0490, 0.0382),
            lobe(0.821, 568.8, 0.0213, 0.0247) + lobe(0.286, 530.9, 0.0613, 0.0322),
            lobe(1.217, 437.0, 0.0845, 0.0278) + lobe(0.681, 459.0, 0.0385, 0.0725),
        ]
    )
    matching *= (D50 / (matching @ shining))[:, None]
    return tuple(tuple(row) for row in matching.tolist())
