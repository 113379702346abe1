"""What all measured faults of a lens share: each belongs to one part of the sensor, and to one focal length."""

import math
from dataclasses import MISSING, fields
from typing import Any, ClassVar, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from .errors import InputError
from .figures import number, shown

Number = TypeVar("Number", bound=np.floating)

ZOOMED = 0.02
"""Relative difference of focal lengths from which on they are two."""


class OfLens:
    """Base of what is measured of a lens: checks of the frames and of the focal length that it was measured with.

    size: (rows, columns) of the frames that it was measured on; other frames have to have the same ratio of sides, but for a pixel.
    focal_length: of the lens then, millimetres; None = unknown.
    """

    size: tuple[int, int]
    focal_length: float | None
    _name: ClassVar[str]  # for messages
    _harm: ClassVar[str]  # what is wrong at another focal length

    def _check_frame(self) -> None:
        """Check `size` and `focal_length`, and make `size` a tuple. Raises InputError that names the field."""
        sides = tuple(self.size) if isinstance(self.size, tuple | list) else ()
        if len(sides) != 2 or not all(type(side) is int and 0 < side < 1 << 20 for side in sides):
            raise InputError(f"{self._name}: size is {shown(self.size)}, expected [rows, columns]")
        object.__setattr__(self, "size", sides)
        if self.focal_length is not None:
            self._check_figure("focal_length")

    def _check_figure(self, name: str) -> None:
        value = number(f"{self._name}: {name}", getattr(self, name))
        if not 0 <= value < 1e6:
            raise InputError(f"{self._name}: {name} is {value:g}, expected 0 to a million")

    def check_channels(self, channels: str) -> None:
        """Raise InputError unless it has figures for each of these channels (letters), and for no others."""
        raise NotImplementedError

    @classmethod
    def from_json(cls, document: Any) -> Self:
        """Return what a JSON object with this class's fields describes. Raises InputError that names the field."""
        known = {each.name: each.default is MISSING for each in fields(cls)}  # type: ignore[arg-type]
        required = {name for name, needed in known.items() if needed}
        if not isinstance(document, dict) or not required <= document.keys() <= known.keys():
            *names, last = (f'"{name}"' for name in known)
            raise InputError(f"calibration: {cls._name} is not an object with {', '.join(names)} and {last}")
        return cls(**document)

    def check(self, shape: tuple[int, int]) -> None:
        """Raise InputError unless it can be that of frames of this shape, (rows, columns)."""
        # One frame can be the other made smaller if one scale gives both of its sides, but for a part of a pixel.
        small, large = sorted((shape, self.size))
        if small != large and max((small[i] - 1) / large[i] for i in (0, 1)) >= min((small[i] + 1) / large[i] for i in (0, 1)):
            raise InputError(
                f"the {self._name} was measured on frames of {self.size[1]} x {self.size[0]} pixels, and the frame has "
                f"{shape[1]} x {shape[0]}: another part of the sensor; measure it on such frames, into a camera file of its own"
            )

    @property
    def at_focal_length(self) -> str:
        """Its focal length, for people; "" if it is unknown."""
        return f" at {self.focal_length:g} mm" if self.focal_length else ""

    def zoomed(self, focal_length: float | None) -> str:
        """A note on a shot at this focal length, millimetres: "" unless this was measured at another one.

        >>> from shared import Shading
        >>> Shading([[[1.0] * 4] * 4] * 4, (800, 1200), focal_length=35).zoomed(50)
        'taken at 50 mm, but its shading was measured at 35 mm: colours towards the corners may be wrong'
        """
        known = self.focal_length
        if not known or not focal_length or abs(math.log(focal_length / known)) <= ZOOMED:
            return ""
        return f"taken at {focal_length:g} mm, but its {self._name} was measured at {known:g} mm: {self._harm}"


def spline_weights(t: NDArray[Number]) -> NDArray[Number]:
    """Return the weights of the four control points of a uniform cubic B-spline around places 0 <= t < 1, (4, ...).

    The places lie between the second and the third control point.

    >>> import numpy as np
    >>> from shared.lens import spline_weights
    >>> (6 * spline_weights(np.array([0.0]))).ravel().tolist()
    [1.0, 4.0, 1.0, 0.0]
    """
    weights: NDArray[Number] = np.stack([(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, 1 + 3 * t + 3 * t**2 - 3 * t**3, t**3])
    weights /= t.dtype.type(6)
    return weights
