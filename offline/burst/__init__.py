"""A hand-held series of frames of one scene: where they lie against one of them."""

from ..memory import burst_memory
from .alignment import Alignment, align
from .frames import View
from .motion import Motion
from .render import MergedBurst, merge_burst, render_burst_bands
from .selection import Judged, copies

__all__ = [
    "Alignment",
    "Judged",
    "MergedBurst",
    "Motion",
    "View",
    "align",
    "burst_memory",
    "copies",
    "merge_burst",
    "render_burst_bands",
]
