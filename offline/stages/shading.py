"""Make the light of a picture even that falls off towards the corners, equally for all filters."""

from dataclasses import dataclass, replace

from ...shared.shading import Shading
from ..bands import Band, RowStage


@dataclass(eq=False)
class ShadingCorrection(RowStage):
    """Undo the shading of the panchromatic plane in a picture, (rows, columns) of which are
    `shape`.

    All stages before see a frame that is darker towards its corners, so that noise and saturation
    are the sensor's everywhere.
    """

    shading: Shading
    shape: tuple[int, int]

    name = "shading"

    def __call__(self, band: Band, rows: tuple[int, int]) -> Band:
        """These rows as without shading."""
        shown = band.rows(*rows)
        gain = self.shading.of_plane(self.shape, -1, slice(*rows))
        return replace(shown, luminance=shown.luminance * gain)
