"""Shots: what the camera has recorded, from a file or a simulation, its own picture of it, and the
full-quality one.
"""

from __future__ import annotations  # help() then shows them as they are written here

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from .pictures import Image, Picture, checked_flag
from .shared import CaptureMetadata, CfaPattern, FloatArray, InputError, Mosaic, SensorCalibration
from .shared.camera import read_camera
from .shared.dng import read_dng, write_dng
from .shared.figures import whole
from .shared.reading import MAX_PIXELS, File, file_name, is_file
from .tools.batch.burst_files import checked_reference, series
from .tools.batch.chosen_white import WhiteBalance
from .tools.batch.console import fault
from .tools.batch.folders import DNGS, search
from .tools.batch.in_memory import camera_preview, merged_picture, note_once, render_array
from .tools.batch.order import settings_named
from .tools.batch.progress import StageProgress
from .tools.io.display import upright

if TYPE_CHECKING:
    from .offline import RenderSettings, Stages


@dataclass(frozen=True, eq=False, repr=False, match_args=False)
class Shot:
    """A shot: one sample per pixel, behind the filters of the camera's pattern. Jupyter shows its
    preview.

    Attributes
    ----------
    mosaic : Mosaic
        Samples (`mosaic.codes`, `mosaic.signal` in scene units), with pattern, calibration and
        capture data.
    truth : Picture | None
        The light that a simulated camera saw, in the units of a render; None for other shots.
    name : str
        Of the file or the scene.
    notes : tuple[str, ...]
        Remarks on how the scene or the file was understood; standard error has each of them too,
        once in a run.

    Examples
    --------
    >>> import panchroma
    >>> shot = panchroma.simulate("builtin:120x90", sigma=0.01)
    >>> shot
    <Shot builtin-120x90: 120 x 90, R, G, B in 4 of 6 x 6 pixels>
    >>> shot.save("shot.dng")
    >>> panchroma.open("shot.dng")
    <Shot shot: 120 x 90, R, G, B in 4 of 6 x 6 pixels>

    Samples of your own sensor: 12 bits behind the paper's pattern, black 64 and white 4095:

    >>> import numpy as np
    >>> from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
    >>> codes = np.full((60, 80), 1000, np.uint16)
    >>> levels = SensorCalibration.of_bits(12, headroom=False, black_level=(64, 64, 64, 64))
    >>> mosaic = Mosaic(codes, CfaPattern.bayer(period=6), levels)
    >>> panchroma.render(panchroma.Shot(mosaic))
    <Picture 80 x 60, linear R, G, B>
    """

    mosaic: Mosaic
    truth: Picture | None = None
    name: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.mosaic, Mosaic):
            found = f"this one {type(self.mosaic).__name__}"
            raise InputError(f"a shot holds a Mosaic(samples, pattern, calibration), {found}")

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        return self.mosaic.shape

    @property
    def pattern(self) -> CfaPattern:
        """The filters: `pattern.tile`, `pattern.channels`, `pattern.filter_map(shot.shape)`."""
        return self.mosaic.pattern

    @property
    def calibration(self) -> SensorCalibration:
        """Calibration of the sensor: gamma, noise, levels, colours."""
        return self.mosaic.calibration

    @property
    def metadata(self) -> CaptureMetadata:
        """Capture data: camera, lens, exposure, orientation."""
        return self.mosaic.metadata

    def save(self, path: File, *, overwrite: bool = False) -> None:
        """Write the shot with its preview as a DNG, which `open` reads.

        Samples of floating point become codes of the calibration: they are rounded, and end at its
        highest code.

        Parameters
        ----------
        overwrite : bool, optional
            Replace an existing file.
        """
        if isinstance(path, str | PathLike) and Path(path).suffix.lower() != ".dng":
            raise InputError(f"{path}: a shot is saved as a DNG; end its name in .dng")
        write_dng(path, self.mosaic, camera_preview(self.mosaic), overwrite=checked_flag(overwrite))

    def __repr__(self) -> str:
        (rows, columns), pattern = self.shape, self.pattern
        sites, period = f"{len(pattern.sites)} of {pattern.period}", pattern.period
        filters = f"{', '.join(pattern.channels)} in {sites} x {period} pixels"
        return f"<{' '.join(filter(None, ('Shot', self.name)))}: {columns} x {rows}, {filters}>"

    def _repr_png_(self) -> bytes:
        return preview(self)._repr_png_()


Shots: TypeAlias = Shot | File | Sequence[Shot | File]
"""Shots, their files, or the name of a folder with them."""


def open(  # noqa: A001
    path: File, *, camera: File | None = None, max_pixels: int = MAX_PIXELS
) -> Shot:
    """Read a shot, a DNG that Panchroma has written. For photographs of other cameras see
    `simulate`.

    Parameters
    ----------
    path : File
        The file: its name, or a file object such as io.BytesIO.
    camera : File | None, optional
        A camera.json (from `panchroma calibrate`) to use in place of the shot's own calibration.
    max_pixels : int, optional
        A larger shot is refused.

    Raises
    ------
    PanchromaError
        That names the file and says what is wrong with it.

    Examples
    --------
    >>> import panchroma
    >>> panchroma.simulate("builtin:120x90").save("leaves.dng")
    >>> panchroma.open("leaves.dng").shape
    (90, 120)
    """
    mosaic = read_dng(path, max_pixels=max_pixels)
    if camera is not None:
        mosaic = read_camera(camera).calibrated(mosaic)
    notes = mosaic.calibration.remarks(mosaic.metadata.focal_length)
    return with_notes_shown(Shot(mosaic, name=Path(file_name(path)).stem, notes=notes))


def preview(shot: Shot | File, *, scale: int = 1) -> Image:
    """The camera's own picture of a shot: made in milliseconds by an ONNX graph, upright.

    Parameters
    ----------
    shot : Shot | File
        A `Shot`, or its file.
    scale : int, optional
        Pixels of the sensor, each way, that become one of the preview; a divisor of the pattern's
        period.

    Raises
    ------
    PanchromaError
        For another scale.

    Examples
    --------
    >>> import panchroma
    >>> panchroma.preview(panchroma.simulate("builtin:120x90"), scale=3)
    <Image 40 x 30, 8-bit sRGB>
    """
    mosaic = as_shot(shot).mosaic
    return Image(upright(camera_preview(mosaic, scale), mosaic.metadata.orientation))


def render(
    shot: Shot | File,
    *,
    preset: str | RenderSettings = "best",
    wb: str | Sequence[float] = "camera",
    max_memory: int | str | None = None,
    stages: Stages | None = None,
) -> Picture:
    """Reconstruct every channel at every pixel, on all processors. The same shot gives the same
    picture, to the bit.

    The first render on a machine compiles the renderer, which takes about half a minute and is said
    on standard error; in a terminal, `panchroma doctor` does it ahead, on all processors.

    Parameters
    ----------
    shot : Shot | File
        A `Shot` (which may hold an array of your own), or its file.
    preset : str | RenderSettings, optional
        "best"; "unlearned": best without the networks that correct luminance and colour; "paper":
        the method as published; or settings of your own, such as
        dataclasses.replace(offline.BEST, ...).
    wb : str | Sequence[float], optional
        White balance of what is shown and saved: "camera" (as shot), "auto" (estimated), the place
        (x, y) of a grey in the upright picture, or multipliers (2.1, 1, 1.6); it does not change
        `Picture.rgb`.
    max_memory : int | str | None, optional
        Memory that may be used, for example "4G", or bytes; None = most of the free memory.
    stages : Stages | None, optional
        Makes the list of stages that go over the picture in rows, as `offline.render` takes it;
        None = those of the settings.

    Raises
    ------
    PanchromaError
        For a shot that is all black, or all saturated, and for one that needs more memory than may
        be used.

    Examples
    --------
    >>> import panchroma
    >>> shot = panchroma.simulate("builtin:120x90", sigma=0.01)
    >>> panchroma.render(shot)
    <Picture 120 x 90, linear R, G, B>
    """
    settings, white = _settings(preset), WhiteBalance.parse(wb)
    shot = as_shot(shot)
    mosaic = white.of(shot.mosaic)
    rgb, lost = render_array(mosaic, settings, stages, max_memory)
    return _picture(rgb, mosaic, settings, shot, lost=lost)


def burst(
    shots: Shots,
    *,
    reference: int | str | Path | None = None,
    shifts: Sequence[tuple[float, float]] = (),
    preset: str | RenderSettings = "best",
    wb: str | Sequence[float] = "camera",
    camera: File | None = None,
    max_memory: int | str | None = None,
    max_pixels: int = MAX_PIXELS,
) -> Picture:
    """Merge a series of one scene, hand-held or from a sensor that moves by known steps, into one
    picture, with less noise and more colour.

    Frames are aligned, and merged where they agree with the reference; what has moved is the
    reference's alone. A frame that does not fit, or is a copy of another one, is left out, which is
    logged.

    Parameters
    ----------
    shots : Shots
        Two or more, each a `Shot` or its file; or the name of a folder with the frames
        of one burst, STEM-1.dng, STEM-2.dng ...
    reference : int | str | Path | None, optional
        The frame that the picture shows: its place among `shots`, counted from 0, or the name of
        its file. By default the first of the sharpest.
    shifts : Sequence[tuple[float, float]], optional
        Pixel shift: (right, down), where the sensor was at each shot, in columns and rows of its
        pixels. Nothing is aligned then, and the reference is the first shot by default.
    preset : str | RenderSettings, optional
        "best"; "unlearned": best without the networks that correct luminance and colour; or
        settings of your own.
    wb : str | Sequence[float], optional
        White balance of what is shown and saved, as of `render`; the place of a grey is that in the
        reference, or in the first shot.
    camera : File | None, optional
        A camera.json (from `panchroma calibrate`) to use in place of the shots' own calibration.
    max_memory : int | str | None, optional
        Memory that may be used, as of `render`.
    max_pixels : int, optional
        A larger shot is refused.

    Returns
    -------
    Picture
        `Picture.facts` says which frame is the reference, and of each how it has moved and why it
        is left out.

    Raises
    ------
    PanchromaError
        For a shot that cannot be read, for shots with other channels, and for more of them than
        fit the memory.

    Examples
    --------
    >>> import panchroma
    >>> shots = panchroma.simulate("builtin:120x90", burst=3, motion=2, sigma=0.02)
    >>> picture = panchroma.burst(shots, reference=0)
    >>> picture, picture.facts["reference"], [frame["used"] for frame in picture.facts["frames"]]
    (<Picture 92 x 62, linear R, G, B>, 'shots[0]', [True, True, True])
    """
    settings, white = _settings(preset), WhiteBalance.parse(wb)
    try:
        places = tuple((float(right), float(down)) for right, down in shifts)
    except (TypeError, ValueError):
        expected = "expected (right, down) of each shot"
        raise InputError(f"`shifts` is {shifts!r}, {expected}") from None
    named, held = named_shots(shots, "shots")
    files = search(named, DNGS)
    for folder, wrong in files.failures:
        raise InputError(f"{folder}: {wrong}")
    names = series(files.sources)
    if not names:
        raise InputError("`shots` is empty; expected two or more of one scene")
    if len(names) == 1 and names[0] not in held:
        open(names[0], max_pixels=max_pixels)  # says what is wrong with it
    by_name = reference if isinstance(reference, str | Path) else None
    index = checked_reference(names, by_name, places)
    if not (reference is None or by_name):
        index = whole("`reference`", reference)
        if not 0 <= index < len(names):
            raise InputError(f"`reference` is {reference}, expected 0 to {len(names) - 1}")
    known = read_camera(camera) if camera is not None else None
    order = {"preset": settings, "white": white, "camera": known, "reference": index}
    progress, read = StageProgress(note=note_once), reader(held, max_pixels)
    rgb, subject = merged_picture(names, progress, read, max_memory, **order, shifts=places)
    facts = subject.facts()
    shown = held.get(facts["reference"])
    return _picture(rgb, subject.mosaic, settings, shown, lost=subject.lost, facts=facts)


def _settings(preset: str | RenderSettings) -> RenderSettings:
    """The settings of a preset; what is not installed is named, with the remedy."""
    try:
        return settings_named(preset)
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(fault(error), name=error.name) from None


def _picture(
    rgb: FloatArray, mosaic: Mosaic, settings: RenderSettings, shot: Shot | None, **known: Any
) -> Picture:
    """A picture of this mosaic, that of a shot if it is in memory."""
    level = shot.truth.white if shot and shot.truth else 1.0
    restored = settings.highlights.restored
    return Picture(rgb, mosaic.calibration, mosaic.metadata, level, restored, **known)


def with_notes_shown(shot: Shot) -> Shot:
    """The shot, after the log has those of its notes that it has not had yet: a sweep opens
    or simulates it many times.
    """
    for note in shot.notes:
        note_once(f"{shot.name}: {note}")
    return shot


def named_shots(shots: Shots, argument: str) -> tuple[list[str], dict[str, Shot]]:
    """The name of each shot, that of its file or its place in the argument, such as "dark[0]"; and
    the shots that are in memory, by these names.
    """
    held: dict[str, Shot] = {}
    names = []
    listed: Any = [shots] if isinstance(shots, Shot) or is_file(shots) else shots
    for number, shot in enumerate(listed):
        if isinstance(shot, str | PathLike):
            names.append(file_name(shot))
        else:
            names.append(f"{argument}[{number}]")
            held[names[-1]] = as_shot(shot)
    return names, held


def reader(held: Mapping[str, Shot], max_pixels: int) -> Callable[[str], Mosaic]:
    """Return what gives a shot by its name: that in memory, or else that in the file."""
    return lambda name: held[name].mosaic if name in held else read_dng(name, max_pixels=max_pixels)


def as_shot(shot: Shot | File) -> Shot:
    """The shot itself, or that in a file."""
    if not (isinstance(shot, Shot) or is_file(shot)):
        made = "Shot(Mosaic(codes, pattern, calibration)) is one of codes of your own"
        raise InputError(f"{type(shot).__name__} is neither a shot nor its file; {made}")
    return shot if isinstance(shot, Shot) else open(shot)
