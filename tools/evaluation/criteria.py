"""The figures by which methods are compared: all that the protocol measures, so that no verdict leaves one out."""

from math import isnan
from typing import NamedTuple

from .measures import PLANES, TITLES

EVEN = 0.05  # dB: smaller differences count as none


class Criterion(NamedTuple):
    """One way to compare methods: medians say how most of a picture looks, the others how its worst places do.

    name: in the JSON file.
    title: for people.
    explanation: what the figure is, with its unit.
    sign: 1 where more is better, -1 where less is.
    unit: after a difference, for people.
    digits: decimals that people are shown.
    even: smaller differences count as none.
    """

    name: str
    title: str
    explanation: str
    sign: int = 1
    unit: str = " dB"
    digits: int = 1
    even: float = EVEN

    def text(self, value: float) -> str:
        """A figure for people; a dash where there is none (NaN)."""
        return "–" if isnan(value) else f"{value:.{self.digits}f}"

    def difference(self, lead: float) -> str:
        """A lead (positive: ours is better) as the difference of the figures, with its sign."""
        return f"{self.sign * lead:+.{self.digits}f}"


_PLANES = tuple(zip(PLANES, TITLES, strict=True))
_HUE = "Pixels more than 10 CIEDE2000 from the truth, white balanced and at display exposure, %; lower is better."
CRITERIA = (  # in the order of `Figure.values`
    *(Criterion(name, f"median {title}", f"Median {title} PSNR of all patches, dB; higher is better.") for name, title in _PLANES),
    *(
        Criterion(
            f"{name}_q10",
            f"worst tenth, {title}",
            f"{title[0].upper()}{title[1:]} PSNR that nine tenths of the patches reach (10 % quantile), dB; higher is better.",
        )
        for name, title in _PLANES
    ),
    *(
        Criterion(
            "psnr" if name == "rgb" else f"psnr_{name}",
            f"whole image, {title}",
            f"{title[0].upper()}{title[1:]} PSNR of whole images, dB, mean over the scenes; higher is better.",
        )
        for name, title in _PLANES
    ),
    Criterion("ssim", "SSIM", "SSIM of whole images, mean over the scenes; higher is better.", unit="", digits=3, even=0.0005),
    Criterion("wrong_hue", "wrong hue", _HUE, -1, " % of the pixels"),
)
RGB, LUMINANCE, CHROMINANCE = range(3)  # places in CRITERIA
TENTH, TENTH_CHROMINANCE, WHOLE, SSIM, HUE = 3, 5, 6, 9, 10  # of the worst tenth and of whole images without a name: those in RGB
