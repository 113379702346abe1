"""The interface between the builder of a preview graph and its runtime: names, types, versions, metadata.

**Geometry.** The graph takes any number of whole K x K patches (`shared.pattern.BlockGrid`), with a halo of further pixels on each
side, and returns the picture of the patches. The tile in it begins at the first pixel of a patch, so that one graph serves every
origin of a pattern. It also serves all cameras with that pattern: everything that differs between cameras is an input.

Inputs, for a pattern of C channels; all but the first are float32:
    mosaic  uint16 (rows, columns)  sensor codes, or finer ones without shading (`device.preview.even_light`)
    black   (C + 1,)                black level per plane (the channels, then panchromatic), such codes
    scale   (C + 1,)                scene units per code of each plane
    gamma   (C,)                    weights of Eq. 7
    noise   (2,)                    (shot, read_variance) of a panchromatic sample: variance = shot * signal + read_variance, scene
                                    units; read_variance is the square of `NoiseModel.read`
    white   (C,)                    reading of display white, scene units; display graphs only
    matrix  (3, C)                  camera RGB relative to white -> linear sRGB; display graphs only
Output, with one pixel per scale x scale sensor pixels:
    picture uint8 (rows, columns, 3) sRGB of a display graph, float32 (rows, columns, C) scene units of a linear graph
"""

from collections.abc import Mapping
from dataclasses import dataclass

from shared.errors import InputError
from shared.pattern import PERIODS, CfaPattern

OPSET = 17
IR_VERSION = 8  # as old as the opset; by default onnx writes a version that current releases of onnxruntime refuse
VERSION = "1"

MOSAIC, BLACK, SCALE, GAMMA, NOISE, WHITE, MATRIX = "mosaic", "black", "scale", "gamma", "noise", "white", "matrix"
PICTURE = "picture"

_PREFIX = "panchroma."
_WIDEST_HALO = 256  # pixels; our graphs need less than three periods


@dataclass(frozen=True)
class Description:
    """The properties of a graph, kept in its metadata.

    tile: letters from the first pixel of a patch on; rows are separated by "/".
    channels: the letters of the channels, in order.
    scale: sensor pixels per picture pixel, each way.
    linear: scene units instead of a picture for a screen.
    halo: pixels above, below, left and right of the patches that the graph reads.
    builder: version of `device.preview.graph` that wrote it.
    """

    tile: str
    channels: str
    scale: int
    linear: bool
    halo: tuple[int, int, int, int]
    builder: str

    def check(self, pattern: CfaPattern) -> None:
        """Raise InputError unless the graph was made for this pattern."""
        for name, ours, theirs in (("pattern", self.tile, tile_name(pattern)), ("channels", self.channels, pattern.channels)):
            if ours != theirs:
                raise InputError(f"the preview graph is for the {name} {ours}, the mosaic has {theirs}")
        if pattern.period % self.scale:
            raise InputError(f"the preview graph has scale {self.scale}, which is no divisor of the period {pattern.period}")

    def to_metadata(self) -> dict[str, str]:
        """The properties as strings, for the ONNX file."""
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
    """The properties in the metadata of an ONNX file. Raises InputError for any other model, and for another version."""
    if (found := metadata.get(_PREFIX + "contract")) is None:
        raise InputError("the model is no preview graph of Panchroma; panchroma export-preview writes one")
    if found != VERSION:
        raise InputError(
            f"the preview graph has contract {found}, this program {VERSION}; write it again: panchroma export-preview"
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
    """The tile of a graph: its letters from the first pixel of a patch on, rows separated by "/"."""
    down, across = (origin + block // 2 for origin, block in zip(pattern.block_origin, pattern.block_shape, strict=True))
    return "/".join(pattern.letters_from((down, across)))


def file_name(pattern: CfaPattern, scale: int, *, linear: bool) -> str:
    """File name of a graph in the package, from block, period and scale: for example "rggb-k6-s1.onnx"."""
    rows, columns = pattern.block_shape
    letters = "".join(row[:columns] for row in pattern.letters_from(pattern.block_origin)[:rows])
    return f"{letters.lower()}-k{pattern.period}-s{scale}{'-linear' if linear else ''}.onnx"
