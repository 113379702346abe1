"""The faults of a simulated lens. A new one is a subclass of `LensFault` in a file of its own, and a line in `FAULTS`."""

from collections.abc import Iterable, Mapping, Sequence

from shared import SensorCalibration
from shared.errors import InputError

from .aberration import AberrationFault, lens_aberration
from .fault import LensFault
from .shading import ShadingFault, lens_shading

__all__ = ["FAULTS", "AberrationFault", "LensFault", "ShadingFault", "check_lens", "lens_aberration", "lens_of", "lens_shading"]

FAULTS: dict[str, type[LensFault]] = {each.name: each for each in (ShadingFault, AberrationFault)}


def lens_of(figures: Mapping[str, Sequence[float] | None]) -> tuple[LensFault, ...]:
    """The faults that are asked for, in the order of FAULTS.

    figures: those of each fault by its name; None, or zeros alone: without this fault.
    Raises InputError for another number of figures, and for figures out of range.
    """
    return tuple(fault.of(asked) for name, fault in FAULTS.items() if (asked := figures.get(name)) is not None and any(asked))


def check_lens(lens: Iterable[LensFault], known: SensorCalibration, source: object) -> None:
    """Raise InputError, naming the source of a calibration, if that knows a fault of this kind already."""
    for fault in lens:
        if fault.is_known(known):
            raise InputError(f"{source} has its own {fault.name}: leave `{fault.name}` out")
