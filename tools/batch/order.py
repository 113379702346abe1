"""Order of a run, and sources of a picture."""

import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ...shared import Camera, Mosaic, read_dng
from ...shared.arrays import ByteArray, FloatArray
from ...shared.errors import InputError
from ...shared.progress import Progress
from ...shared.reading import MAX_PIXELS
from ..io.development import Development
from ..io.kind import PictureKind
from .checks import check_light
from .chosen_white import AS_SHOT, WhiteBalance
from .jobs import Job
from .journal import key
from .progress import Note

if TYPE_CHECKING:
    from ...offline import RenderSettings


class Subject:
    """One shot, and the settings with which it is rendered. `burst_files.BurstSubject` is the
    frames of a burst.

    lost: where light is lost in the picture (`offline.Rendering.lost`), after `bands`.

    Parameters
    ----------
    mosaic : Mosaic
        Whose size, colours and capture data the picture has; of a burst any frame, until `prepare`
        has chosen one. A single shot is given up by `bands`, to save memory.
    count
        Number of frames.
    errors : tuple[str, ...]
        A line for each file that failed, where others are left to render.
    words
        What is special about the picture, for people; "" for nothing.
    """

    count = 1
    errors: tuple[str, ...] = ()
    words = ""

    def __init__(self, mosaic: Mosaic, settings: "RenderSettings") -> None:
        self.mosaic, self.settings = mosaic, settings
        self.lost: ByteArray | None = None

    def prepare(self, progress: Progress) -> None:
        """Do all that comes before `bands`.

        Raises InputError if there can be no picture.
        """

    def bands(self, progress: Progress) -> Iterator[FloatArray]:
        """Yield the picture as `offline.colour_bands` does."""
        from ...offline import colour_bands, measure

        # only `measure` holds the shot from now on
        measured = measure(vars(self).pop("mosaic"), self.settings, progress)
        self.lost = measured.lost
        return colour_bands(measured, self.settings, progress)

    def facts(self) -> dict[str, Any]:
        """Peculiarities of the picture, for machines."""
        return {}


def settings_named(preset: object) -> "RenderSettings":
    """The settings of a preset by name, or settings of one's own.

    Raises InputError for anything else.
    """
    from ...offline import PRESETS, RenderSettings

    if isinstance(preset, RenderSettings):
        return preset
    if preset not in PRESETS:
        expected = f"one of {', '.join(PRESETS)}, or offline.RenderSettings"
        raise InputError(f"`preset` is {preset!r}, expected {expected}")
    return PRESETS[str(preset)]


@dataclass(frozen=True)
class Order:
    """Settings that all pictures of a run share.

    Attributes
    ----------
    folder : Path
        The output folder, home of the journal.
    kind : PictureKind
        Format, bits and colour space of the pictures.
    preset : str | RenderSettings
        See `settings_named`.
    exposure : float
        Gain of a display picture, stops.
    camera : Camera | None
        Replaces the calibration in the shots.
    run : str
        Name of this run in the journal.
    white : WhiteBalance
        White balance of the pictures.
    max_pixels : int
        Largest shot that is read.
    resume : bool
        Keep pictures that are up to date, replace those of an earlier render that are not.
    overwrite : bool
        Replace any existing file.
    dry_run : bool
        Write nothing, only report what would be done.
    no_matter : ClassVar[frozenset[str]]
        The fields that change no picture, but only whether, where and when it is made.
    """

    no_matter: ClassVar[frozenset[str]] = frozenset(
        {"folder", "run", "max_pixels", "resume", "overwrite", "dry_run"}
    )

    folder: Path
    kind: PictureKind
    preset: "str | RenderSettings"
    exposure: float
    camera: Camera | None
    run: str
    white: WhiteBalance = AS_SHOT
    max_pixels: int = MAX_PIXELS
    resume: bool = False
    overwrite: bool = False
    dry_run: bool = False

    @property
    def settings(self) -> Any:
        """RenderSettings of the preset."""
        return settings_named(self.preset)

    def open(self, job: Job, memory: int, note: Note) -> Subject:
        """Read the sources of a picture from its files.

        memory: bytes that may be used. Raises InputError if it cannot become such a picture.
        """
        mosaic = self.read(job.source)
        return Subject(
            mosaic if self.settings.asks_for_codes else mosaic.in_scene_units(), self.settings
        )

    def read(self, source: str) -> Mosaic:
        """Return the shot, calibrated. Raises InputError for one that cannot become a picture."""
        return self.prepared(self.decode(source))

    def decode(self, source: str) -> Mosaic:
        """The shot as it is in the file; this does not load the renderer.

        Raises InputError as `read_dng` does.
        """
        return read_dng(source, max_pixels=self.max_pixels)

    def prepared(self, mosaic: Mosaic) -> Mosaic:
        """A shot, calibrated.

        Raises InputError for one that cannot become such a picture.
        """
        if self.camera is not None:
            mosaic = self.camera.calibrated(mosaic)
        mosaic = self.white.of(mosaic)
        self.development(mosaic).check()
        check_light(mosaic, self.settings)
        return mosaic

    def development(self, mosaic: Mosaic) -> Development:
        """Conversion of a rendering of this mosaic to a picture."""
        restored = self.settings.highlights.restored
        return Development(
            self.kind, mosaic.shape, mosaic.calibration, mosaic.metadata, self.exposure, restored
        )

    def name(self, output: Path) -> str:
        """The picture's path below the folder, as it stands in the journal."""
        return Path(os.path.relpath(output, self.folder)).as_posix()

    def key(self, output: Path, source_digest: str) -> str:
        """Digest of everything that a picture depends on. Orders with equal keys make equal
        pictures.
        """
        return key(input=source_digest, output=self.name(output), order=self._pixel_key)

    @cached_property
    def _pixel_key(self) -> str:
        """Digest of all fields that change pictures, of the settings of the preset, and of the
        algorithm.

        Every field counts that is not named in `no_matter`: one that is added later cannot be
        forgotten.
        """
        from ...offline.version import ALGORITHM

        fields = {name: value for name, value in asdict(self).items() if name not in self.no_matter}
        return key(algorithm=ALGORITHM, settings=asdict(self.settings), **fields)
