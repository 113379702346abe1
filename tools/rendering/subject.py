"""What a picture is rendered from: one shot. `burst.BurstSubject` is the frames of a burst."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from shared import Mosaic
from shared.arrays import ByteArray, FloatArray
from shared.progress import Progress

if TYPE_CHECKING:
    from offline import RenderSettings


class Subject:
    """One shot, and the settings with which it is rendered.

    mosaic: whose size, colours and capture data the picture has; of a burst any frame, until `prepare` has chosen one.
    count: number of frames.
    errors: a line for each file that failed, where others are left to render.
    words: what is special about the picture, for people; "" for nothing.
    lost: where light is lost in the picture (`offline.Rendering.lost`), after `bands`.
    """

    count = 1
    errors: tuple[str, ...] = ()
    words = ""

    def __init__(self, mosaic: Mosaic, settings: "RenderSettings") -> None:
        self.mosaic, self.settings = mosaic, settings
        self.lost: ByteArray | None = None

    def prepare(self, progress: Progress) -> None:
        """Do all that comes before `bands`. Raises InputError if there can be no picture."""

    def bands(self, progress: Progress) -> Iterator[FloatArray]:
        """Yield the picture as `offline.render_bands` does."""
        from offline import colour_bands, measure

        measured = measure(self.mosaic, self.settings, progress)
        self.lost = measured.lost
        return colour_bands(measured, self.settings, progress)

    def beside(self, progress: Progress) -> list[bytes]:
        """Return the contents of the files beside the picture (`Job.outputs`), once its last band has been taken."""
        return []

    def facts(self) -> dict[str, Any]:
        """What is special about the picture, for machines."""
        return {}
