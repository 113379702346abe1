"""What the builder of a preview graph and the runtime agree on: names, types, versions, metadata.

**Geometry.** The graph takes whole K x K patches (`shared.pattern.BlockGrid`), as many as one likes, with a halo of more pixels on
each side, and returns the picture of the patches. It knows the tile as it is seen from a patch's first pixel, so that one graph
serves every origin of a pattern, and all cameras with it: what differs from camera to camera are inputs.

Inputs (C channels of the pattern; float32, but for the first):
    mosaic  uint16 (rows, columns)  sensor codes
    black   (C + 1,)                black level, codes, per plane (the channels, then panchromatic)
    scale   (C + 1,)                scene units per code, per plane
    gamma   (C,)                    Eq. 7
    noise   (2,)                    shot and read: variance of a panchromatic sample = shot * signal + read, scene units
    white   (C,)                    reading of display white, scene units; only of a display graph
    matrix  (3, C)                  camera RGB relative to white -> linear sRGB; only of a display graph
Output:
    picture uint8 (rows, columns, 3) sRGB, or of a linear graph float32 (rows, columns, C) scene units; a pixel per
            scale x scale sensor pixels
"""

from collections.abc import Mapping
from dataclasses import dataclass

from shared.errors import InputError
from shared.pattern import PERIODS, CfaPattern

OPSET = 17
IR_VERSION = 8  # as old as the opset: onnx writes by default what no onnxruntime in use reads
VERSION = "1"

MOSAIC, BLACK, SCALE, GAMMA, NOISE, WHITE, MATRIX = "mosaic", "black", "scale", "gamma", "noise", "white", "matrix"
PICTURE = "picture"

_PREFIX = "panchroma."
_WIDEST_HALO = 256  # pixels; ours have less than three periods


@dataclass(frozen=True)
class Description:
    """What a graph says of itself.

    tile: the letters from the first pixel of a patch on, row by row; halo: pixels above, below, left and right of the patches.
    """

    tile: str
    channels: str
    scale: int
    linear: bool
    halo: tuple[int, int, int, int]
    builder: str

    def check(self, pattern: CfaPattern) -> None:
        """Raise InputError unless the graph is for this pattern."""
        for name, ours, theirs in (("pattern", self.tile, tile_name(pattern)), ("channels", self.channels, pattern.channels)):
            if ours != theirs:
                raise InputError(f"the preview graph is for the {name} {ours}, the mosaic has {theirs}")
        if pattern.period % self.scale:
            raise InputError(f"the preview graph has scale {self.scale}, which is no divisor of the period {pattern.period}")

    def to_metadata(self) -> dict[str, str]:
        """As strings, for the file."""
        values = {
            "contract": VERSION,
            "builder": self.builder,
            "tile": self.tile,
            "channels": self.channels,
            "scale": str(self.scale),
            "output": "linear" if self.linear else "display",
            "halo": " ".join(map(str, self.halo)),
        }
        return {_PREFIX + name: value for name, value in values.items()}


def parse(metadata: Mapping[str, str]) -> Description:
    """Inverse of `Description.to_metadata`; raises InputError for the metadata of anything else, or another contract."""
    if (found := metadata.get(_PREFIX + "contract")) is None:
        raise InputError("the model is no preview graph of Panchroma; panchroma export-preview writes them")
    if found != VERSION:
        raise InputError(
            f"the preview graph keeps contract {found}, this program {VERSION}; write it again: panchroma export-preview"
        )
    try:
        above, below, left, right = (int(side) for side in metadata[_PREFIX + "halo"].split())
        scale = int(metadata[_PREFIX + "scale"])
        if not 1 <= scale < PERIODS.stop:
            raise ValueError(f"a scale of {scale}")
        if not 0 <= min(above, below, left, right) <= max(above, below, left, right) <= _WIDEST_HALO:
            raise ValueError(f"a halo of {above} {below} {left} {right}")
        return Description(
            tile=metadata[_PREFIX + "tile"],
            channels=metadata[_PREFIX + "channels"],
            scale=scale,
            linear=metadata[_PREFIX + "output"] == "linear",
            halo=(above, below, left, right),
            builder=metadata[_PREFIX + "builder"],
        )
    except (KeyError, ValueError) as error:
        raise InputError(
            f"the preview graph's description is damaged ({error}); write it again: panchroma export-preview"
        ) from None


def tile_name(pattern: CfaPattern) -> str:
    """The tile as a graph knows it: its letters from the first pixel of a patch on, rows separated by "/"."""
    down, across = (origin + block // 2 for origin, block in zip(pattern.block_origin, pattern.block_shape, strict=True))
    return "/".join(pattern.letters_from((down, across)))


def file_name(pattern: CfaPattern, scale: int, *, linear: bool) -> str:
    """Of the graph in the package: block, period, scale, such as "rggb-k6-s1.onnx"."""
    rows, columns = pattern.block_shape
    letters = "".join(row[:columns] for row in pattern.letters_from(pattern.block_origin)[:rows])
    return f"{letters.lower()}-k{pattern.period}-s{scale}{'-linear' if linear else ''}.onnx"
