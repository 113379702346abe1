"""What a picture is rendered from: one shot. `burst.Burst` is the frames of a burst."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from shared import Mosaic
from shared.arrays import FloatArray
from shared.progress import Progress

if TYPE_CHECKING:
    from offline import RenderSettings


class Subject:
    """One shot.

    mosaic: whose size, colours and capture data the picture has; of a burst any frame, until `prepare` has chosen one.
    count: number of frames.
    errors: a line for each file that failed, where others are left to render.
    words: what is special about the picture, for people; "" for nothing.
    """

    count = 1
    errors: tuple[str, ...] = ()
    words = ""

    def __init__(self, mosaic: Mosaic) -> None:
        self.mosaic = mosaic

    def prepare(self, settings: "RenderSettings", progress: Progress) -> None:
        """Do all that comes before `bands`. Raises InputError if there can be no picture."""

    def bands(self, settings: "RenderSettings", progress: Progress) -> Iterator[FloatArray]:
        """Yield the picture as `offline.render_bands` does."""
        from offline import render_bands

        return render_bands(self.mosaic, settings, progress)

    def beside(self, settings: "RenderSettings", progress: Progress) -> list[bytes]:
        """Return the contents of the files beside the picture (`Shot.outputs`), once its last band has been taken."""
        return []

    def facts(self) -> dict[str, Any]:
        """What is special about the picture, for machines."""
        return {}
