"""The interface of a preview graph, for `Preview` and for any other runtime: names, types,
versions, metadata.

**Geometry.** The graph takes any number of whole K x K patches (`shared.block_grid`), with a halo
of further pixels on each side,
and returns the picture of the patches. The tile in it begins at the first pixel of a patch, so that
one graph serves every
origin of a pattern. It also serves all cameras with that pattern: everything that differs between
cameras is an input. README.md in
this folder says how a frame is continued beyond its edges, which pixel the picture begins with, and
what camera.json has to do with
the inputs, and has an example without Panchroma.

Inputs, for a pattern of C channels; float32 where nothing else is said:
    mosaic  (rows, columns)         sensor codes, or finer ones without shading
                                    (`device.preview.codes`); uint16 at scale 1
    black   (C + 1,)                black level per plane, in these codes: channels, panchromatic
    scale   (C + 1,)                scene units per code of each plane
    gamma   (C,)                    weights of Eq. 7
    noise   (2,)                    (shot, read_variance) of a panchromatic sample before the gain,
                                    scene units: variance = shot * signal + read_variance;
                                    read_variance is the square of `NoiseModel.read`
    white   (C,)                    reading of display white, scene units; display graphs only
    matrix  (3, C)                  camera RGB relative to white -> linear sRGB; display graphs only
    gain    (n, m)                  gain that undid shading at each block, by which full scale and
                                    noise are higher; n = patches down + 3 and m = patches across +
                                    5, from one block above and two on the left of those at the
                                    corners of the patches on; or 1 for all; without shading [[1]]
Output, with one pixel per scale x scale sensor pixels:
    picture uint8 (rows, columns, 3) sRGB of a display graph, float32 (rows, columns, C) scene units
    of a linear graph

Metadata: panchroma.contract (VERSION), .builder, .tile (letters from the first pixel of a patch on,
rows separated by "/"), .channels (their letters, in order), .scale, .output ("display" or
"linear"), .halo (pixels around the patches: above, below, left, right).
"""

from ...shared.pattern import CfaPattern

VERSION = "4"

MOSAIC, BLACK, SCALE, GAMMA, NOISE = "mosaic", "black", "scale", "gamma", "noise"
WHITE, MATRIX, GAIN = "white", "matrix", "gain"
PICTURE = "picture"


def tile_name(pattern: CfaPattern) -> str:
    """The tile of a graph: its letters from the first pixel of a patch on, rows separated by
    "/".
    """
    return "/".join(pattern.letters_from(pattern.block_middle))
