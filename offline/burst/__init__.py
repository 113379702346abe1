"""A hand-held series of frames of one scene: where they lie against one of them."""

from .alignment import Alignment, align
from .motion import Motion

__all__ = ["Alignment", "Motion", "align"]
