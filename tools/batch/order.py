"""Order of a run, sources of a picture, and one shot or burst rendered to one picture, once, by
whichever process on whichever machine gets it.
"""

import os
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, lru_cache, partial
from pathlib import Path
from secrets import token_hex
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from ...shared import ByteArray, Camera, CodeArray, FloatArray, Mosaic, read_dng
from ...shared.arrays import strips
from ...shared.errors import InputError, OutputError, PanchromaError
from ...shared.processors import threads
from ...shared.progress import Progress
from ...shared.reading import MAX_PIXELS
from ..io.backup import keep_old
from ..io.development import Development
from ..io.kind import PictureKind, write_picture
from .chosen_white import AS_SHOT, WhiteBalance
from .compilation import announced_compilation, compile_ahead
from .console import Console
from .jobs import Job, Outcome, State, file_status, identity, planned, refuse_existing, run_jobs
from .journal import Entry, Journal, digest, key, output_lock
from .memory import check_memory
from .progress import Note, StageProgress

if TYPE_CHECKING:
    from ...offline import RenderSettings

Keep = Callable[[Path], dict[str, Any]]
"""Returns the arguments `overwrite` and `on_complete` of `durable_file` for one output."""
Writing = Callable[[Job, StageProgress, Keep], Outcome]
"""Does a job: writes each output as `durable_file` does, with the arguments that `Keep` returns."""


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


def check_light(mosaic: Mosaic, settings: "RenderSettings") -> None:
    """Raise InputError for a frame that holds no picture for these settings: all black, or all
    saturated.

    Settings that restore luminance from the colour samples accept a frame until these are saturated
    as well. Samples of floating point have no limit: see `offline.render`.
    """
    if mosaic.samples.dtype.kind != "u":
        return
    codes, calibration, restored = mosaic.codes, mosaic.calibration, settings.highlights.restored

    def panchromatic() -> Iterator[CodeArray]:
        """Yield the panchromatic samples, a few rows at a time: of a picture the first ones say
        enough.
        """
        for rows in strips(len(codes)):
            shape = codes[rows].shape[0], codes.shape[1]
            yield codes[rows][mosaic.pattern.panchromatic_mask(shape, (rows.start, 0))]

    if not any(samples.size for samples in panchromatic()):
        return
    if not any((samples > calibration.black_level[-1]).any() for samples in panchromatic()):
        reason = "nothing was exposed, or the calibration's black level is too high"
        raise InputError(f"no sample is above the black level: {reason}")
    counted = (codes[rows] for rows in strips(len(codes))) if restored else panchromatic()
    if not any((samples < calibration.white_level).any() for samples in counted):
        which = "sample" if restored else "panchromatic sample"
        raise InputError(f"every {which} is saturated: there is no picture in it; expose less")


@dataclass(frozen=True, kw_only=True)
class Run:
    """Settings of a run that decide which of its results are made.

    Attributes
    ----------
    folder : Path
        The output folder, home of the journal.
    run : str
        Name of this run in the journal.
    resume : bool
        Keep results that are up to date, replace those of an earlier run that are not.
    overwrite : bool
        Replace any existing file.
    dry_run : bool
        Write nothing, only report what would be done.
    made_by : str
        Digest of all settings that change its files; empty in an `Order`, whose key comes from its
        fields.
    outputs : frozenset[Path]
        Outputs of all jobs of the run, of which some may not have been made yet.
    """

    folder: Path
    run: str = field(default_factory=partial(token_hex, 8))
    resume: bool = False
    overwrite: bool = False
    dry_run: bool = False
    made_by: str = ""
    outputs: frozenset[Path] = frozenset()

    @property
    def may_replace(self) -> bool:
        """True if an existing file need not stay."""
        return self.overwrite or self.resume

    @property
    def journal(self) -> Journal:
        """The journal of its folder."""
        return _journal(self.folder, self.run)

    def name(self, output: Path) -> str:
        """The output's path below the folder, as it stands in the journal."""
        return Path(os.path.relpath(output, self.folder)).as_posix()

    def key(self, output: Path, source_digest: str) -> str:
        """Digest of everything that a file depends on."""
        return key(input=source_digest, output=self.name(output), order=self.made_by)


@dataclass(frozen=True)
class Order(Run):
    """Settings that all pictures of a run share.

    Attributes
    ----------
    kind : PictureKind
        Format, bits and colour space of the pictures.
    preset : str | RenderSettings
        See `settings_named`.
    exposure : float
        Gain of a display picture, stops.
    camera : Camera | None
        Replaces the calibration in the shots.
    white : WhiteBalance
        White balance of the pictures.
    max_pixels : int
        Largest shot that is read.
    no_matter : ClassVar[frozenset[str]]
        The fields that change no picture, but only whether, where and when it is made.
    """

    no_matter: ClassVar[frozenset[str]] = frozenset(
        {"folder", "run", "max_pixels", "resume", "overwrite", "dry_run", "made_by", "outputs"}
    )

    kind: PictureKind
    preset: "str | RenderSettings" = "best"
    exposure: float = 0.0
    camera: Camera | None = None
    white: WhiteBalance = AS_SHOT
    max_pixels: int = MAX_PIXELS

    @property
    def settings(self) -> Any:
        """RenderSettings of the preset."""
        return settings_named(self.preset)

    def open(self, job: Job, memory: int, note: Note) -> Subject:
        """Read the sources of a picture from its files.

        memory: bytes that may be used. Raises InputError if it cannot become such a picture.
        """
        mosaic = self.read(job.source)
        if not self.settings.asks_for_codes:
            mosaic = mosaic.in_scene_units()
        return Subject(mosaic, self.settings)

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
        self.kind.kept_as.check(self.development(mosaic))
        check_light(mosaic, self.settings)
        return mosaic

    def development(self, mosaic: Mosaic) -> Development:
        """Conversion of a rendering of this mosaic to a picture."""
        sensor = mosaic.calibration, mosaic.metadata
        restored = self.settings.highlights.restored
        return Development(self.kind, mosaic.shape, *sensor, self.exposure, restored)

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


def attempt(order: Order, memory: int, workers: int, job: Job, listener: StageProgress) -> Outcome:
    """Make a picture, or find that it is there already.

    Raises InputError, ForeignFileError, OutputError: there can be no picture.

    Parameters
    ----------
    order
        Settings of the run.
    memory
        Bytes that may be used.
    workers
        Number of processes that may be started to compile the renderer; 1 in a process that was
        started itself.
    job
        The shot or burst, and where its picture goes.
    listener
        Takes stages, and remarks for the user.
    """
    output = job.output
    if not (order.dry_run or order.folder.is_dir()):
        raise OutputError(f"{order.folder}: is not there any more; run again when it is")
    read = partial(order.open, job, memory, listener.note)
    if not any(map(file_status, job.files)):
        read()  # says what is wrong with it, before a folder is made for its picture
    with _in_turn(order, job):
        if not order.dry_run:
            return _make(order, memory, workers, job, listener)
        if _is_unchanged(order, job) or _existing(order, job, output, _digest(job)).current:
            return _up_to_date(output, "current", dry_run=True)
        return planned(job, read().errors)


@contextmanager
def _in_turn(run: Run, job: Job) -> Iterator[None]:
    """Let one process at a time look up and make the results of a job, in a `with` block; a dry run
    does not wait.

    Raises OutputError for an OSError.
    """
    try:
        if not run.dry_run:
            job.make_folders()
        with nullcontext() if run.dry_run else output_lock(job.output):
            yield
    except PanchromaError:
        raise
    except OSError as error:
        raise OutputError(f"{job.output}: cannot be written ({error.strerror or error})") from error


def _make(order: Order, memory: int, workers: int, job: Job, listener: StageProgress) -> Outcome:
    """Make the picture, while this process holds the lock on the output."""
    start, output, kind = time.monotonic(), job.output, order.kind
    if _is_unchanged(order, job):
        return _up_to_date(output, "current")
    stamp, output_stamp = _stamp(job.files), _stamp([output])
    source_digest = _digest(job)
    existing = _existing(order, job, output, source_digest)
    if existing.current:
        _note_stamp(order, output, f"{stamp} {output_stamp}")
        return _up_to_date(output, existing.current)
    listener.stage("reading", 1)
    subject = order.open(job, memory, listener.note)
    with announced_compilation(listener):
        if source_digest is None or _digest(job) != source_digest:
            remedy = "render it again when it is complete"
            raise InputError(f"{job.source}: has changed while it was read; {remedy}")
        check_memory(subject.mosaic, kind, order.settings, memory, subject.count)
        # now that only the writing can fail
        compile_ahead(workers, listener)
        for remark in _assumptions(subject.mosaic, kind.has_white_balance):
            listener.note(f"{job.source}: {remark}")
        subject.prepare(listener)
        development, pattern = order.development(subject.mosaic), subject.mosaic.pattern
        if existing.changed:
            kept = keep_old(output).name
            listener.note(f"{output}: has changed since it was made; it is kept as {kept}")
        # Journal and picture are fsynced at the same time: for small pictures fsync takes most of
        # the time, and a large one is digested meanwhile. The pool is this picture's own: one that
        # stays would wait for ever for a thread whose start is interrupted.
        with ThreadPoolExecutor(1) as pool:
            # without a damaged frame it is not up to date: it is made, and that named, again
            made = order, job, output, "" if subject.errors else source_digest
            bands = _whitened(subject.bands(listener), subject.lost, development, listener)
            write_picture(
                output,
                bands,
                development,
                overwrite=existing.replace,
                on_complete=lambda partial: pool.submit(_note_in_journal, *made, partial).result,
                threads=threads(),
            )
        if not subject.errors:
            _note_stamp(order, output, f"{stamp} {_stamp([output])}")
    from ...offline import network_name

    seconds, calibration = time.monotonic() - start, development.calibration
    rows, columns = development.written_shape
    size = f"{columns} x {rows}, {kind.bits} bits, {kind.space}"
    line = f"{output}: {size}, {subject.words}{seconds:.1f} s"
    network = network_name(pattern) if order.settings.learned.used else None
    facts = {"output": str(output), "width": columns, "height": rows, "seconds": round(seconds, 3)}
    facts |= {"neutral": calibration.neutral, "neutral_estimated": calibration.neutral_estimated}
    facts |= {"learned": network, **subject.facts()}
    return Outcome(facts, (line,), subject.errors)


def _up_to_date(output: Path, state: State, **facts: bool) -> Outcome:
    record: dict[str, Any] = {"output": str(output), "current": True, **facts}
    return Outcome(record, (f"{output}: is up to date",), state=state)


def _assumptions(mosaic: Mosaic, has_white_balance: bool) -> Iterator[str]:
    calibration = mosaic.calibration
    if calibration.noise is None:
        yield "the noise level is unknown; calibrate the camera for better colour"
    if not calibration.knows_white and has_white_balance:
        yield 'the white balance is unknown; `wb="auto"` estimates it'
    yield from calibration.remarks(mosaic.metadata.focal_length)


def _whitened(
    bands: Iterable[FloatArray], lost: ByteArray | None, shown: Development, listener: StageProgress
) -> Iterator[FloatArray]:
    """Yield the bands as the picture shows them. lost: where light is lost."""
    top = 0
    for band in bands:
        yield shown.whitened(band, None if lost is None else lost[top : top + len(band)])
        top += len(band)
    listener.stage("writing", 1)


def do_kept(run: Run, jobs: list[Job], work: Writing, console: Console, **settings: Any) -> int:
    """Do jobs as `run_jobs` does, each as `kept` says; returns the exit code.

    settings: of `run_jobs`.
    """
    outputs = frozenset(output for job in jobs for output in job.outputs)
    do = partial(kept, replace(run, outputs=outputs), work)
    return run_jobs(jobs, do, console, overwrite=run.may_replace, **settings)


def kept(run: Run, work: Writing, job: Job, listener: StageProgress) -> Outcome:
    """Do a job, unless its files are all up to date; what is written is noted in the journal."""
    with _in_turn(run, job):
        source = _digest(job) or key(drawn=job.source)
        found = {output: _existing(run, job, output, source) for output in job.outputs}
        if all(each.current for each in found.values()):
            return _up_to_date(job.output, "current")
        # files that an earlier run made with these: they may be taken for those of this one
        entries = run.journal.made_with(map(run.name, job.outputs))
        made = {run.folder / entry.output: entry for entry in entries if entry.digest}
        outdated = {path for path, entry in made.items() if entry.key != run.key(path, source)}
        left_over = outdated - run.outputs

        def keep(output: Path) -> dict[str, Any]:
            if found[output].changed:
                changed = f"has changed since it was made; it is kept as {keep_old(output).name}"
                listener.note(f"{output}: {changed}")
            note = partial(_note_in_journal, run, job, output, source)
            replaced = found[output].replace
            return {"overwrite": replaced, "on_complete": lambda whole: partial(note, whole)}

        outcome = work(job, listener, keep)
        for path in sorted(filter(os.path.lexists, left_over)):
            what = "was made with what is replaced, and does not belong to what is there now"
            listener.note(f"{path}: {what}: remove it")
        return outcome


def _note_in_journal(run: Run, job: Job, output: Path, source: str, whole: Path) -> None:
    made = run.name(output), digest(whole) or "", run.key(output, source)
    path = os.path.abspath(job.source)  # noqa: PTH100 (without following links)
    run.journal.append(Entry(*made, run.run, path, source))


def _note_stamp(order: Order, output: Path, stamp: str) -> None:
    """Note sizes and times of files that are as the last entry says: the next run need not read
    them. Getting its name changed the picture's.
    """
    journal = order.journal
    journal.append(replace(journal.of(order.name(output))[-1], stamp=stamp), wait=False)


def _is_unchanged(order: Order, job: Job) -> bool:
    """True if the picture is up to date by sizes and times alone: reading all files of an archive
    takes long.
    """
    entries = order.journal.of(order.name(job.output)) if order.resume else []
    if not entries or entries[-1].stamp != f"{_stamp(job.files)} {_stamp([job.output])}":
        return False
    return entries[-1].key == order.key(job.output, entries[-1].input)


class _Existing(NamedTuple):
    """Existing file under the name of an output.

    current: the outcome when it is up to date, made by this run or by an earlier one; otherwise
    None. replace: it may be replaced. changed: a render made it, and somebody has changed it since.
    """

    current: State | None = None
    replace: bool = False
    changed: bool = False


def _existing(run: Run, job: Job, output: Path, source: str | None) -> _Existing:
    """Look up what exists under the name of the output. Raises OutputError for a file that must
    stay.
    """
    entries = run.journal.of(run.name(output))
    last = entries[-1] if entries else None
    if file_status(output) is None:
        # a run has found that there can be no such file
        absent = last is not None and (last.digest, last.key) == ("", run.key(output, source or ""))
        return _Existing("current" if run.resume and absent else None, run.overwrite)
    # by a process that died before it could say so
    of_this_run = last is not None and last.run == run.run
    if not (run.resume or of_this_run):
        if not run.overwrite:
            refuse_existing([output])
        return _Existing(replace=True)
    current = digest(output)
    up_to_date = current, run.key(output, source or "")
    if last and source and (last.digest, last.key) == up_to_date:
        return _Existing("made" if of_this_run else "current", True)
    if run.overwrite:
        return _Existing(replace=True)
    if not last:
        reason = "exists already, and no run noted that it made it; `overwrite=True` replaces it"
        raise OutputError(f"{output}: {reason}")
    first, second = identity(last.source), identity(job.source)
    if first and second and first != second:  # two files, rather than one that was moved
        remedy = "use another output folder, or `overwrite=True`"
        raise OutputError(f"{output}: is the result of {last.source}; {remedy}")
    return _Existing(replace=True, changed=current not in {entry.digest for entry in entries})


def _digest(job: Job) -> str | None:
    """Digest of the files that a picture is made from; None if there is only one, and it cannot be
    read.
    """
    frames = job.frames
    return key(frames=[digest(name) for name in frames]) if frames else digest(job.source)


@lru_cache(maxsize=1)  # so that a process reads a long journal once a run
def _journal(folder: Path, run: str) -> Journal:
    return Journal(folder)


def _stamp(files: Iterable[str | Path]) -> str:
    """Digest of the size of each file and of the times at which it was modified and changed:
    programs that edit a file may set the former back, and none can set the latter.
    """
    found = map(file_status, files)
    return key(files=[one and (one.st_size, one.st_mtime_ns, one.st_ctime_ns) for one in found])
