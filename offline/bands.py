"""A picture goes from stage to stage in bands, from top to bottom; every stage says how far it
looks, and gets what it needs.

Nothing is computed twice, and the picture does not depend on where bands begin.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple, Protocol

import numpy as np

from ..shared.arrays import FloatArray, Pair
from ..shared.errors import InputError
from ..shared.progress import SILENT, Progress

DARK = 1e-6
"""Luminance, scene units, below which a pixel has no chromaticity that could be corrected, and a
difference is no edge. No photograph changes.
"""


@dataclass(frozen=True, eq=False)
class Band:
    """Rows of a picture that are rendered together.

    Attributes
    ----------
    first : int
        The frame's row that is its first.
    luminance : FloatArray
        float32 (rows, W), scene units.
    chromaticity : FloatArray
        float32 (rows, W, C).
    residual : FloatArray | None
        Sample minus picture at the colour sites, times gamma (so that all channels have the unit of
        luminance), before the picture was corrected; 0 elsewhere and beside clipped samples,
        float32 (rows, W). None = not measured yet.

    Examples
    --------
    >>> import numpy as np
    >>> from panchroma.offline import Band
    >>> Band(10, np.ones((4, 6), np.float32), np.ones((4, 6, 3), np.float32)).rows(11, 13).end
    13
    """

    first: int
    luminance: FloatArray
    chromaticity: FloatArray
    residual: FloatArray | None = None

    @property
    def end(self) -> int:
        """The frame's row after its last."""
        return self.first + len(self.luminance)

    @classmethod
    def joined(cls, bands: Sequence["Band"]) -> "Band":
        """The rows of bands of which each follows the one before; a single one as it is."""
        if len(bands) == 1:
            return bands[0]
        planes = [dict(band._planes()) for band in bands]
        joined = {name: np.concatenate([each[name] for each in planes]) for name in planes[0]}
        return cls(bands[0].first, **joined)

    def rows(self, first: int, end: int) -> "Band":
        """Rows `first` to `end` of the frame alone; views."""
        within = slice(first - self.first, end - self.first)
        return Band(first, **{name: plane[within] for name, plane in self._planes()})

    def _planes(self) -> list[tuple[str, FloatArray]]:
        names = [field.name for field in fields(self)][1:]
        return [(name, plane) for name in names if (plane := getattr(self, name)) is not None]


class Halo(NamedTuple):
    """Rows of the picture that a stage needs around those that it computes.

    Attributes
    ----------
    radius : int
        Rows above and below that the result of a row depends on.
    alignment, offset : int
        Requested rows end where (row - offset) is a multiple of `alignment`, or at the end of the
        picture.

    Examples
    --------
    >>> from panchroma.offline import Halo
    >>> Halo(radius=3)
    Halo(radius=3, alignment=1, offset=0)
    """

    radius: int = 0
    alignment: int = 1
    offset: int = 0


class RowStage(Protocol):
    """A stage that goes over the picture in rows. What is said here are defaults; a stage needs no
    more than `__call__`.

    Attributes
    ----------
    name : str
        For progress.

    Examples
    --------
    >>> from panchroma.offline import RowStage
    >>> class Same(RowStage):
    ...     def __call__(self, band, rows):
    ...         return band.rows(*rows)
    >>> Same().halo
    Halo(radius=0, alignment=1, offset=0)
    """

    name: str = "stage"

    @property
    def halo(self) -> Halo:
        """Rows around the requested ones that the stage needs."""
        return Halo()

    def __call__(self, band: Band, rows: tuple[int, int]) -> Band:
        """The picture in these rows, first and end.

        Parameters
        ----------
        band : Band
            `halo.radius` rows more on both sides, as far as the frame goes.
        """
        ...


def run_stages(
    bands: Iterable[Band], stages: Iterable[RowStage], height: int, progress: Progress = SILENT
) -> Iterable[Band]:
    """Lead a picture that arrives in bands, from top to bottom, through the stages.

    Parameters
    ----------
    height : int
        Its rows.

    Examples
    --------
    >>> import numpy as np
    >>> from panchroma.offline.bands import Band, RowStage, run_stages
    >>> class Darker(RowStage):
    ...     def __call__(self, band, rows):
    ...         shown = band.rows(*rows)
    ...         return Band(shown.first, shown.luminance / 2, shown.chromaticity)
    >>> bands = [Band(row, np.ones((1, 4), np.float32), np.ones((1, 4, 3), np.float32)) for row in
    ...     range(2)]
    >>> [float(band.luminance.max()) for band in run_stages(bands, [Darker(), Darker()], 2)]
    [0.25, 0.25]
    """
    for stage in stages:
        bands = _apply_stage(bands, stage, height, progress)
    return bands


def _apply_stage(
    bands: Iterable[Band], stage: RowStage, height: int, progress: Progress
) -> Iterator[Band]:
    """The picture after one stage, in bands. Raises InputError for what a stage of one's own
    returns, if it is no such band.
    """
    ours = type(stage).__module__.startswith(f"{__package__}.")
    for band, rows in regroup(bands, height, stage.halo):
        progress.substep(stage.name)
        made = stage(band, rows)
        yield made if ours else _checked(made, f"the stage {stage.name!r} returned", band, rows)


def _checked(made: object, returned: str, band: Band, rows: tuple[int, int]) -> Band:
    """Output of a user's stage for these rows, with contiguous planes. Raises InputError, which
    begins with `returned`.
    """
    if not isinstance(made, Band) or made.luminance is None or made.chromaticity is None:
        raise InputError(f"{returned} {type(made).__name__}, expected an offline.Band with planes")
    width, channels = band.chromaticity.shape[1:]
    shape = rows[1] - rows[0], width
    shapes = {"luminance": shape, "chromaticity": (*shape, channels), "residual": shape}
    planes = {name: np.ascontiguousarray(plane) for name, plane in made._planes()}
    for name, plane in planes.items():
        received, expected = f"{plane.dtype} {plane.shape}", f"float32 {shapes[name]}"
        if received != expected:
            raise InputError(f"{returned} a {name} that is {received}, expected {expected}")
        if not np.isfinite(plane).all():
            raise InputError(f"{returned} a {name} that is not finite")
    if made.first != rows[0]:
        wanted = f"expected {rows[0]} to {rows[1]}: band.rows(*rows) cuts them out"
        raise InputError(f"{returned} rows from {made.first} on, {wanted}")
    return Band(made.first, **planes)


def regroup(bands: Iterable[Band], height: int, halo: Halo) -> Iterator[tuple[Band, Pair]]:
    """Cut a picture into other bands: yield (band, rows), where a band holds `halo.radius` rows
    more around `rows`.

    Parameters
    ----------
    bands : Iterable[Band]
        From top to bottom.
    height : int
        Rows of the whole picture.
    """
    waiting, done = list[Band](), 0
    for band in bands:
        waiting.append(band)
        end = band.end
        if end < height:
            end -= halo.radius
            end -= (end - halo.offset) % halo.alignment
        if end > done:
            held = Band.joined(waiting)
            yield held, (done, end)
            done = end
            rest = held.rows(max(done - halo.radius, held.first), held.end)
            waiting = [rest] if rest.end > rest.first else []
