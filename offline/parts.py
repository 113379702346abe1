"""A picture goes from stage to stage in parts, from top to bottom; every stage says how far it
looks, and gets what it needs.

Nothing is computed twice, and the picture does not depend on where parts begin.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple, Protocol

import numpy as np

from ..shared.arrays import FloatArray
from ..shared.errors import InputError
from ..shared.progress import SILENT, Progress
from .numerics.pieces import copy_together

DARK = 1e-6
"""Luminance, scene units, below which a pixel has no chromaticity that could be corrected. No
photograph changes.
"""
_ROUNDING = 1e-4  # of the largest value: what a filter may differ by from band to band


@dataclass(frozen=True, eq=False)
class Part:
    """Some rows of a picture.

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
    >>> from panchroma.offline import Part
    >>> Part(10, np.ones((4, 6), np.float32), np.ones((4, 6, 3), np.float32)).rows(11, 13).end
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
    def joined(cls, parts: Sequence["Part"]) -> "Part":
        """The rows of parts of which each follows the one before; a single one as it is."""
        if len(parts) == 1:
            return parts[0]
        first, end = parts[0].first, parts[-1].end
        planes = {
            name: np.empty((end - first, *plane.shape[1:]), plane.dtype)
            for name, plane in parts[0]._planes()
        }
        copies = [
            (planes[name][part.first - first : part.end - first], plane)
            for part in parts
            for name, plane in part._planes()
        ]
        copy_together(copies)
        return cls(first, **planes)

    def rows(self, first: int, end: int) -> "Part":
        """Rows `first` to `end` of the frame alone; views."""
        within = slice(first - self.first, end - self.first)
        return Part(first, **{name: plane[within] for name, plane in self._planes()})

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
    ...     def __call__(self, part, rows):
    ...         return part.rows(*rows)
    >>> Same().halo
    Halo(radius=0, alignment=1, offset=0)
    """

    name: str = "stage"

    @property
    def halo(self) -> Halo:
        """Rows around the requested ones that the stage needs."""
        return Halo()

    def __call__(self, part: Part, rows: tuple[int, int]) -> Part:
        """The picture in these rows, first and end.

        Parameters
        ----------
        part : Part
            `halo.radius` rows more on both sides, as far as the frame goes.
        """
        ...


def run_stages(
    parts: Iterable[Part],
    stages: Iterable[RowStage],
    height: int,
    progress: Progress = SILENT,
    *,
    check_halos: bool = False,
) -> Iterable[Part]:
    """Lead a picture that arrives in parts, from top to bottom, through the stages.

    Parameters
    ----------
    height : int
        Its rows.
    check_halos : bool, optional
        Raise InputError if a stage of one's own depends on more rows than its halo has: each part
        is made a second time, in two halves. It cannot tell from less than two rows.

    Examples
    --------
    >>> import numpy as np
    >>> from panchroma.offline.parts import Part, RowStage, run_stages
    >>> class Darker(RowStage):
    ...     def __call__(self, part, rows):
    ...         shown = part.rows(*rows)
    ...         return Part(shown.first, shown.luminance / 2, shown.chromaticity)
    >>> parts = [Part(row, np.ones((1, 4), np.float32), np.ones((1, 4, 3), np.float32)) for row in
    ...     range(2)]
    >>> [float(part.luminance.max()) for part in run_stages(parts, [Darker(), Darker()], 2)]
    [0.25, 0.25]
    """
    for stage in stages:
        parts = apply_stage(parts, stage, height, progress, check_halos=check_halos)
    return parts


def apply_stage(
    parts: Iterable[Part],
    stage: RowStage,
    height: int,
    progress: Progress = SILENT,
    *,
    check_halos: bool = False,
) -> Iterator[Part]:
    """The picture after one stage, part by part; see `run_stages`.

    Raises
    ------
    InputError
        For what a stage of one's own returns, if it is no such part.
    """
    ours = type(stage).__module__.startswith(f"{__package__}.")
    for part, rows in regroup(parts, height, stage.halo):
        progress.part(stage.name)
        made = stage(part, rows)
        if not ours:
            made = _checked(made, f"the stage {stage.name!r} returned", part, rows)
            if check_halos:
                _check_halo(stage, part, made)
        yield made


def _check_halo(stage: RowStage, part: Part, made: Part) -> None:
    """Raise InputError if a stage makes other rows of a part that is cut in the middle, as far from
    there as its halo says.
    """
    radius, alignment, offset = stage.halo
    middle = offset + ((made.first + made.end) // 2 - offset) // alignment * alignment
    upper = made.first, middle, part.first, min(middle + radius, part.end)
    lower = middle, made.end, max(middle - radius, part.first), part.end
    for first, end, *cut in (upper, lower) if made.first < middle < made.end else ():
        again = dict(stage(part.rows(*cut), (first, end))._planes())
        for name, plane in made.rows(first, end)._planes():
            apart = np.abs(again[name] - plane).reshape(end - first, -1).max(axis=1)
            if apart.max() > _ROUNDING * max(float(np.abs(plane).max()), DARK):
                raise InputError(
                    f"the stage {stage.name!r} looks farther than its {stage.halo}: {name} in row "
                    f"{first + int(apart.argmax())} depends on rows beyond; state a larger radius"
                )


def _checked(made: object, returned: str, part: Part, rows: tuple[int, int]) -> Part:
    """Output of a user's stage for these rows, with contiguous planes. Raises InputError, which
    begins with `returned`.
    """
    if not isinstance(made, Part):
        raise InputError(f"{returned} {type(made).__name__}, expected an offline.Part")
    width, channels = part.chromaticity.shape[1:]
    shape = rows[1] - rows[0], width
    shapes = {"luminance": shape, "chromaticity": (*shape, channels), "residual": shape}
    planes = {name: getattr(made, name) for name in shapes}
    for name, plane in planes.items():
        if plane is None and name == "residual":
            continue
        received, expected = type(plane).__name__, f"float32 {shapes[name]}"
        if isinstance(plane, np.ndarray):
            received = f"{plane.dtype} {plane.shape}"
        if received != expected:
            raise InputError(f"{returned} a {name} that is {received}, expected {expected}")
        if not np.isfinite(plane).all():
            row, column = np.argwhere(~np.isfinite(plane))[0, :2].tolist()
            place = f"first in row {rows[0] + row}, column {column}"
            raise InputError(f"{returned} a {name} that is not finite, {place}")
        planes[name] = np.ascontiguousarray(plane)
    if made.first != rows[0]:
        wanted = f"expected {rows[0]} to {rows[1]}: part.rows(*rows) cuts them out"
        raise InputError(f"{returned} rows from {made.first} on, {wanted}")
    return Part(made.first, **planes)


def regroup(
    parts: Iterable[Part], height: int, halo: Halo
) -> Iterator[tuple[Part, tuple[int, int]]]:
    """Cut a picture into other parts: yield (part, rows), where the part holds `halo.radius` rows
    more around `rows`.

    Parameters
    ----------
    parts : Iterable[Part]
        From top to bottom.
    height : int
        Rows of the whole picture.
    """
    waiting, done = list[Part](), 0
    for part in parts:
        waiting.append(part)
        end = part.end
        if end < height:
            end -= halo.radius
            end -= (end - halo.offset) % halo.alignment
        if end > done:
            held = Part.joined(waiting)
            yield held, (done, end)
            done = end
            rest = held.rows(max(done - halo.radius, held.first), held.end)
            waiting = [rest] if rest.end > rest.first else []
