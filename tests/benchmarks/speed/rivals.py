"""Rivals timed on a Bayer mosaic of the same size; preparing their input is not timed."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec

from tools.evaluation.rivals.libraw import develop
from tools.evaluation.rivals.packages import demosaic_malvar, demosaic_menon, edge_aware

from .material import Material
from .rounds import Work


@dataclass(frozen=True)
class TimedRival:
    """One rival.

    name: for people.
    module, distribution: what it needs.
    prepare: brings a frame into the form that it takes, and returns the work to be timed.
    """

    name: str
    module: str
    distribution: str
    prepare: Callable[[Material], Work]

    @property
    def installed(self) -> bool:
        """Whether its package is installed."""
        return find_spec(self.module) is not None


def _libraw(algorithm: str) -> TimedRival:
    return TimedRival(f"LibRaw, {algorithm}", "rawpy", "rawpy", lambda frame: partial(develop, frame.bayer_dng, algorithm))


_COLOUR = "colour_demosaicing", "colour-demosaicing"
_OPENCV = "cv2", "opencv-contrib-python-headless"
RIVALS = (
    TimedRival("colour-demosaicing, Menon 2007", *_COLOUR, lambda frame: partial(demosaic_menon, frame.bayer)),
    TimedRival("colour-demosaicing, Malvar 2004", *_COLOUR, lambda frame: partial(demosaic_malvar, frame.bayer)),
    *map(_libraw, ("AHD", "DCB", "AAHD", "PPG")),
    TimedRival("OpenCV, edge-aware", *_OPENCV, lambda frame: partial(edge_aware, frame.bayer_codes, "RGGB")),
)


def limit_threads(count: int) -> None:
    """Let OpenCV use `count` threads. LibRaw reads OMP_NUM_THREADS instead, when it is loaded."""
    if find_spec("cv2") is not None:
        import cv2

        cv2.setNumThreads(count)
