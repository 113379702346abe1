"""The white balance of a render: that of the shot, an estimate, or multipliers."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ...shared import Mosaic
from ...shared.errors import InputError
from ...shared.white_balance import balanced, estimate_neutral
from ..io.kind import AS_MEASURED, PictureKind

_CAMERA, _AUTO = "camera", "auto"
_LARGEST = 1000.0  # multiplier; its inverse is the smallest


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
    """

    kind: str = _CAMERA
    multipliers: tuple[float, ...] = ()

    @classmethod
    def parse(cls, requested: str | Iterable[float]) -> "WhiteBalance":
        """The white balance that is asked for: "camera", "auto", or multipliers, as numbers or as a
        text such as "2.1,1,1.6".

        Raises
        ------
        InputError
            For anything else.
        """
        if isinstance(requested, str) and requested in (_CAMERA, _AUTO):
            return cls(requested)
        try:
            multipliers = tuple(
                map(float, requested.split(",") if isinstance(requested, str) else requested)
            )
        except (ValueError, TypeError):
            multipliers = ()
        fitting = all(1 / _LARGEST <= multiplier <= _LARGEST for multiplier in multipliers)
        if len(multipliers) < 2 or not fitting:
            raise InputError(
                f"`wb` is {requested!r}, expected {_CAMERA}, {_AUTO} or multipliers R,G,B such as "
                f"2.1,1,1.6, between {1 / _LARGEST:g} and {_LARGEST:g}"
            )
        return cls("", tuple(multiplier / min(multipliers) for multiplier in multipliers))

    def check(self, kind: PictureKind) -> None:
        """Raise InputError if this kind of picture has no white balance."""
        if self.kind != _CAMERA and not kind.has_white_balance:
            raise InputError(f"`wb` is no choice here: {AS_MEASURED}")

    def of(self, mosaic: Mosaic) -> Mosaic:
        """The mosaic with this white balance in its calibration.

        Raises
        ------
        InputError
            If it is impossible for this shot.
        """
        calibration = mosaic.calibration
        if self.kind == _CAMERA:
            return mosaic
        if self.kind == _AUTO:
            neutral = estimate_neutral(mosaic)
            if neutral is None:
                raise InputError(
                    "too dark, too bright or too small to estimate the white balance; give "
                    '`wb="camera"` or multipliers'
                )
            return mosaic.calibrated(balanced(calibration, np.array(neutral), estimated=True))
        if len(self.multipliers) != len(calibration.channels):
            count, channels = len(self.multipliers), ", ".join(calibration.channels)
            raise InputError(
                f"`wb` has {count} multipliers, expected one for each channel of the sensor: "
                f"{channels}"
            )
        return mosaic.calibrated(balanced(calibration, 1 / np.array(self.multipliers)))


AS_SHOT = WhiteBalance()
