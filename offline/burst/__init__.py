"""A hand-held series of frames of one scene: where they lie against one of them."""

from .alignment import Alignment, align
from .judging import Judged
from .motion import Motion
from .render import MergedBurst, merge_burst, render_burst_bands

__all__ = ["Alignment", "Judged", "MergedBurst", "Motion", "align", "merge_burst", "render_burst_bands"]
