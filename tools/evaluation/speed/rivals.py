"""What others make of a Bayer mosaic of the same size: only their own work is timed, not the bringing of their input."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec

from ..rivals.libraw import develop
from ..rivals.packages import demosaic_malvar, demosaic_menon, edge_aware
from .material import Material
from .rounds import Work

_LIBRAW = ("AHD", "DCB", "AAHD", "PPG")


@dataclass(frozen=True)
class Peer:
    """One rival: its name, the module it needs and its distribution, and what it does with a frame."""

    name: str
    module: str
    distribution: str
    prepare: Callable[[Material], Work]

    @property
    def installed(self) -> bool:
        """Whether its package is."""
        return find_spec(self.module) is not None


def _menon(material: Material) -> Work:
    return partial(demosaic_menon, material.bayer)


def _malvar(material: Material) -> Work:
    return partial(demosaic_malvar, material.bayer)


def _libraw(algorithm: str, material: Material) -> Work:
    return partial(develop, material.bayer_dng, algorithm)


def _opencv(material: Material) -> Work:
    return partial(edge_aware, material.bayer_codes, "RGGB")


PEERS = (
    Peer("colour-demosaicing, Menon 2007", "colour_demosaicing", "colour-demosaicing", _menon),
    Peer("colour-demosaicing, Malvar 2004", "colour_demosaicing", "colour-demosaicing", _malvar),
    *(Peer(f"LibRaw, {name}", "rawpy", "rawpy", partial(_libraw, name.lower())) for name in _LIBRAW),
    Peer("OpenCV, edge-aware", "cv2", "opencv-contrib-python-headless", _opencv),
)


def limit_threads(count: int) -> None:
    """Let OpenCV use so many threads; LibRaw is told by OMP_NUM_THREADS, before it is loaded."""
    if find_spec("cv2") is not None:
        import cv2

        cv2.setNumThreads(count)
