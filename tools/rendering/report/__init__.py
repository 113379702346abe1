"""The report on a burst: one HTML page that shows what was merged, and what it is good for."""

from .page import page
from .shown import Shown

__all__ = ["Shown", "page"]
