"""White balance of a stream whose colours nobody has measured: estimated from its frames, and
steady from frame to frame.
"""

import numpy as np

from ...shared.arrays import DoubleArray
from ...shared.mosaic import Mosaic
from ...shared.white_balance import balanced, estimate_neutral

# fraction of the way to a new frame's own estimate: half of a change of light is followed in eleven
# frames
_FOLLOWS = 1 / 16


class SteadyWhite:
    """Balances the frames of one stream, in their order. The estimate is a running mean, so it
    cannot flicker.

    Frames whose calibration knows what white reads pass unchanged, and so do those before the first
    one that is bright enough.
    """

    def __init__(self) -> None:
        self._logarithm: DoubleArray | None = None  # of the neutral

    def __call__(self, mosaic: Mosaic) -> Mosaic:
        """The frame with an estimated neutral in its calibration, and marked so."""
        calibration = mosaic.calibration
        if calibration.knows_white:
            return mosaic
        found = estimate_neutral(mosaic)
        if found is not None:
            observed = np.log(found)
            before = observed if self._logarithm is None else self._logarithm
            self._logarithm = before + _FOLLOWS * (observed - before)
        if self._logarithm is None:
            return mosaic
        return mosaic.calibrated(balanced(calibration, np.exp(self._logarithm), estimated=True))
