"""The white balance of a render: that of the shot, an estimate, that of a grey in the picture, or
multipliers.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ...shared import InputError, Mosaic
from ...shared.white_balance import GREY_BOX, balanced, estimate_neutral, neutral_at
from ..io.development import AS_MEASURED
from ..io.display import upright
from ..io.kind import PictureKind

_CAMERA, _AUTO = "camera", "auto"
_MOST_WB = 1000.0  # multiplier; its inverse is the smallest


@dataclass(frozen=True)
class WhiteBalance:
    """White balance of pictures.

    Attributes
    ----------
    kind : str
        "camera": the neutral of the shot; "auto": estimated from the whole mosaic; "" if there are
        multipliers.
    multipliers : tuple[float, ...]
        One per channel, as raw developers have them: a channel is brighter for a larger one. Only
        their ratios matter.
    grey : tuple[int, int] | None
        (x, y) of a pixel of the upright picture that shows a grey. Of a sensor with two channels
        the same numbers are multipliers, if these may be as large and as small.
    """

    kind: str = _CAMERA
    multipliers: tuple[float, ...] = ()
    grey: tuple[int, int] | None = None

    @classmethod
    def parse(cls, requested: str | Iterable[float]) -> "WhiteBalance":
        """The white balance that is asked for: "camera", "auto", multipliers or the place of a
        grey, as numbers or as a text such as "2.1,1,1.6" or "620,410".

        Raises InputError for anything else.
        """
        if isinstance(requested, str) and requested in (_CAMERA, _AUTO):
            return cls(requested)
        numbers = requested.split(",") if isinstance(requested, str) else requested
        try:
            multipliers = tuple(map(float, numbers))
        except (ValueError, TypeError):
            multipliers = ()
        is_place = len(multipliers) == 2 and all(at >= 0 and at % 1 == 0 for at in multipliers)
        if is_place:
            return cls("", multipliers, (int(multipliers[0]), int(multipliers[1])))
        if len(multipliers) < 2 or not _are_multipliers(multipliers):
            limits = f"between {1 / _MOST_WB:g} and {_MOST_WB:g}"
            known = f"{_CAMERA}, {_AUTO}, the place X,Y of a grey, or multipliers R,G,B"
            raise InputError(f"`wb` is {requested!r}, expected {known} such as 2.1,1,1.6, {limits}")
        return cls("", tuple(multiplier / min(multipliers) for multiplier in multipliers))

    def check(self, kind: PictureKind) -> None:
        """Raise InputError if this kind of picture has no white balance."""
        if self.kind != _CAMERA and not kind.has_white_balance:
            raise InputError(f"`wb` is no choice here: {AS_MEASURED}")

    def of(self, mosaic: Mosaic) -> Mosaic:
        """The mosaic with this white balance in its calibration.

        Raises InputError if it is impossible for this shot.
        """
        calibration = mosaic.calibration
        if self.kind == _CAMERA:
            return mosaic
        if self.kind == _AUTO:
            neutral = estimate_neutral(mosaic)
            if neutral is None:
                reason = "too dark, too bright or too small to estimate the white balance"
                raise InputError(f'{reason}; give `wb="camera"` or multipliers')
            return mosaic.calibrated(balanced(calibration, np.array(neutral), estimated=True))
        is_place = len(calibration.channels) > 2 or not _are_multipliers(self.multipliers)
        if self.grey and is_place:
            return self._grey_at(mosaic, *self.grey)
        if len(self.multipliers) != len(calibration.channels):
            count, channels = len(self.multipliers), ", ".join(calibration.channels)
            expected = f"expected one for each channel of the sensor: {channels}"
            raise InputError(f"`wb` has {count} multipliers, {expected}")
        return mosaic.calibrated(balanced(calibration, 1 / np.array(self.multipliers)))

    def _grey_at(self, mosaic: Mosaic, x: int, y: int) -> Mosaic:
        """Return the mosaic, balanced for a grey at this place of the upright picture."""
        places, turn = np.indices(mosaic.shape, sparse=True), mosaic.metadata.orientation
        rows, columns = (upright(np.broadcast_to(place, mosaic.shape), turn) for place in places)
        height, width = rows.shape
        reach = GREY_BOX // 2
        if not (reach <= y < height - reach and reach <= x < width - reach):
            box = f"the {GREY_BOX} x {GREY_BOX} pixels around {x},{y}"
            raise InputError(f"`wb`: {box} are not all in the picture of {width} x {height} pixels")
        neutral = neutral_at(mosaic, int(rows[y, x]), int(columns[y, x]))
        if neutral is None:
            raise InputError(f"`wb`: the picture is clipped or too dark at {x},{y}; name a grey")
        return mosaic.calibrated(balanced(mosaic.calibration, np.array(neutral)))


def _are_multipliers(values: tuple[float, ...]) -> bool:
    return all(1 / _MOST_WB <= value <= _MOST_WB for value in values)


AS_SHOT = WhiteBalance()
