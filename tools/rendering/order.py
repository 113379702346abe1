"""What is asked for and what came of it: the order of a run, a share of the machine, the outcome of one shot."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from shared import Camera, Mosaic, read_dng
from shared.reading import MAX_PIXELS
from tools.pictures.writer import PictureKind, check_output

from .defect_list import Places, with_defects
from .journal import key
from .picture_file import check_light

Note = Callable[[str], None]


@dataclass(frozen=True)
class Order:
    """What all pictures of a run have in common. folder: of the journal; camera: in place of the shots' own calibration; run: names
    this run in the journal; defects: besides those of the calibration; max_pixels: of a shot. resume: pictures that are current
    stay, those that were made here and are not are made anew. overwrite: files that are in the way are replaced, whosever they are.
    dry_run: nothing is made, only found out.
    """

    folder: Path
    kind: PictureKind
    preset: str
    exposure: float
    camera: Camera | None
    run: str
    defects: Places = ()
    max_pixels: int = MAX_PIXELS
    resume: bool = False
    overwrite: bool = False
    dry_run: bool = False

    @property
    def settings(self) -> Any:
        """RenderSettings of the preset."""
        from offline import BEST, PAPER

        return PAPER if self.preset == "paper" else BEST

    def read(self, source: str) -> Mosaic:
        """A shot, calibrated, that can become such a picture. Raises InputError."""
        mosaic = read_dng(source, max_pixels=self.max_pixels)
        if self.camera is not None:
            mosaic = self.camera.calibrated(mosaic)
        if self.defects:
            mosaic = with_defects(mosaic, self.defects)
        check_output(self.kind, mosaic.calibration, mosaic.shape)
        check_light(mosaic, self.settings)
        return mosaic

    def name(self, output: Path) -> str:
        """The picture's path below the folder, as the journal has it."""
        return output.relative_to(self.folder).as_posix()

    def key(self, output: Path, source_digest: str) -> str:
        """Digest of everything the picture depends on."""
        from offline.version import ALGORITHM

        return key(
            input=source_digest,
            settings=asdict(self.settings),
            picture=[self.kind.format, self.kind.bits, self.kind.space, self.exposure],
            calibration=self.camera.calibration.id if self.camera else None,  # the shot's own is part of the shot
            defects=self.defects,
            algorithm=ALGORITHM,
            output=self.name(output),
        )


State = Literal["made", "planned", "current", "foreign", "postponed", "failed"]


@dataclass(frozen=True)
class Outcome:
    """Of one shot. line: for people; facts: for machines.

    planned: it would be made; current: it was there already; foreign: the file is no shot, and nobody had called it one;
    postponed: another process is at it, or it needs more memory than its share.
    """

    state: State
    line: str = ""
    facts: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Share:
    """What one piece of work may use: bytes of memory. last: nothing is postponed any more; it waits for others, and fails."""

    memory: int
    last: bool = False
