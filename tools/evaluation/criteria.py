"""The figures by which methods are compared: all that the protocol measures, so that no verdict leaves one out."""

from math import isnan, nan
from typing import TYPE_CHECKING, NamedTuple

from .measures import PLANES, TITLES

if TYPE_CHECKING:
    from .figures import Figure

EVEN = 0.05  # dB: smaller differences count as none


class Criterion(NamedTuple):
    """One way to compare methods: medians say how most of a picture looks, the others how its worst places do.

    name: in the verdict of the JSON file.
    title: for people.
    figure: name of the value, see `Figure.values`.
    explanation: what the figure is, with its unit.
    sign: 1 where more is better, -1 where less is.
    unit: after a difference, for people.
    digits: decimals that people are shown.
    even: smaller differences count as none.
    scale: from the value to what people are shown.
    """

    name: str
    title: str
    figure: str
    explanation: str
    sign: int = 1
    unit: str = " dB"
    digits: int = 1
    even: float = EVEN
    scale: float = 1.0

    def of(self, figure: "Figure | None") -> float:
        """What people are shown; NaN if there is none."""
        value = None if figure is None else figure.values[self.figure]
        return nan if value is None else self.scale * value

    def text(self, value: float) -> str:
        """A figure for people; a dash where there is none (NaN)."""
        return "–" if isnan(value) else f"{value:.{self.digits}f}"

    def difference(self, lead: float) -> str:
        """A lead (positive: ours is better) as the difference of the figures, with its sign and unit."""
        return f"{self.sign * lead:+.{self.digits}f}{self.unit}"


_PLANES = [(of, name, "" if name == "rgb" else f"_{name}") for name, of in zip(PLANES, TITLES, strict=True)]
_MEDIAN = "PSNR of all patches, dB; higher is better."
_TENTH = "PSNR that nine tenths of the patches reach (10 % quantile), dB; higher is better."
_WHOLE = "PSNR of whole images, dB, mean over the scenes; higher is better."
_HUE = "Pixels more than 10 CIEDE2000 from the truth, white balanced and at display exposure, %; lower is better."
_UNEVEN = "Pixels whose error of a*, b* is 10 from that of the pixels around of the same true colour, %; lower is better."
_FADED = "How far the colour kept in five bins of luminance is from all of it, on the mean, %; lower is better."
CRITERIA = (
    *(Criterion(name, f"median {of}", f"{name}_q50", f"Median {of} {_MEDIAN}") for of, name, _ in _PLANES),
    *(Criterion(f"{name}_q10", f"worst tenth, {of}", f"{name}_q10", f"{of} {_TENTH}") for of, name, _ in _PLANES),
    *(Criterion(f"psnr{end}", f"whole image, {of}", f"psnr{end}", f"{of} {_WHOLE}") for of, _, end in _PLANES),
    Criterion("ssim", "SSIM", "ssim", "SSIM of whole images, mean over the scenes; higher is better.", 1, "", 3, 0.0005),
    Criterion("wrong_hue", "wrong hue", "wrong_hue", _HUE, -1, " % of the pixels", scale=100.0),
    Criterion("uneven_hue", "uneven hue", "uneven_hue", _UNEVEN, -1, " % of the pixels", scale=100.0),
    Criterion("faded", "faded colour", "faded", _FADED, -1, " %", even=0.5, scale=100.0),
)
RGB, LUMINANCE, CHROMINANCE, _, _, TENTH_CHROMINANCE, WHOLE, _, _, SSIM, HUE, _, _ = CRITERIA
"""Those of the worst tenth and of whole images without a name are those in RGB."""
