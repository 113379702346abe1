"""Make the light of a picture even that falls off towards the corners, equally for all filters."""

from dataclasses import dataclass, replace

from ..bands import Band, RowStage
from ..frame import Frame


@dataclass(eq=False)
class ShadingCorrection(RowStage):
    """Undo the shading of the panchromatic plane in the picture of a frame that has some.

    All stages before see a frame that is darker towards its corners, so that noise and saturation
    are the sensor's everywhere.
    """

    frame: Frame

    name = "shading"

    def __call__(self, band: Band, rows: tuple[int, int]) -> Band:
        """These rows as without shading."""
        shown, shading = band.rows(*rows), self.frame.shading
        gain = shading.of_plane(self.frame.shape, -1, slice(*rows)) if shading else 1
        return replace(shown, luminance=shown.luminance * gain)
