"""What a fault of a simulated lens is."""

from abc import ABC
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import ClassVar, Self

from shared import SensorCalibration
from shared.arrays import FloatArray
from shared.errors import InputError


@dataclass(frozen=True)
class LensFault(ABC):
    """A fault of a lens whose optical axis meets the middle of the frame. Its fields are figures, checked when made.

    A fault that calibration can describe overrides `is_known` and `calibrated`; any other one overrides `blurred`.

    name: as an option and as an argument.
    metavar, example, help: of that option; the figures have commas between them.
    """

    name: ClassVar[str]
    metavar: ClassVar[str]
    example: ClassVar[str]
    help: ClassVar[str]

    @classmethod
    def of(cls, figures: Sequence[float]) -> Self:
        """The fault with these figures. Raises InputError for another number of them, and for figures out of range."""
        try:
            return cls(*map(float, figures))
        except TypeError:
            cls._refuse(figures, f"{len(fields(cls))} figures")
            raise

    @classmethod
    def _refuse(cls, figures: Sequence[float], expected: str) -> None:
        """Raise InputError that says what was expected instead of these figures."""
        raise InputError(f"`{cls.name}` is {','.join(map('{:g}'.format, figures))}, expected {cls.metavar}: {expected}") from None

    def is_known(self, calibration: SensorCalibration) -> bool:
        """Whether a calibration describes a fault of this kind."""
        return False

    def calibrated(self, calibration: SensorCalibration, shape: tuple[int, int]) -> SensorCalibration:
        """A calibration that describes this fault, too. shape: (rows, columns) of the frame."""
        return calibration

    def blurred(self, light: FloatArray) -> FloatArray:
        """The light behind the lens, (H, W, C), where calibration cannot describe what this fault does to it."""
        return light
