"""What a program may put before a simulated camera: a file, an array, or linear light that it has already."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared import CaptureMetadata, SensorCalibration
from shared.arrays import FloatArray
from shared.errors import InputError
from tools.scenes.decoders import Decoded, decode_array
from tools.scenes.load import load_scene
from tools.scenes.picture import picture_scene
from tools.scenes.scene import Scene


def scene_in_file(name: str, wanted: str, *, linear: bool, max_pixels: int) -> Scene:
    """The scene in a file, or a drawn one, for a pattern with the channels `wanted`. Raises InputError that names it."""
    try:
        return load_scene(name, linear=linear, max_pixels=max_pixels, channels=wanted)
    except InputError as error:
        raise type(error)(f"{name}: {error}") from None


def scene_in_array(array: NDArray[Any], wanted: str, channels: str | None, *, linear: bool) -> Scene:
    """The scene in an array (H, W, C) with these channels; None = those that fit a pattern with the channels `wanted`.

    Raises InputError for what `decode_array` and `picture_scene` refuse.
    """
    peak = np.iinfo(array.dtype).max if array.dtype.kind == "u" else None
    decoded = decode_array(array, wanted) if channels is None else Decoded(array, peak, channels=channels)
    return picture_scene(decoded, "array", linear=linear)


def scene_of_light(rgb: FloatArray, known: SensorCalibration, metadata: CaptureMetadata) -> Scene:
    """The scene in linear light (H, W, C), in the colours of a calibration; negative light, which is noise, becomes 0."""
    light = np.maximum(rgb, 0)
    return Scene(light, "picture", known.camera_to_xyz, known.neutral, metadata, channels=known.channels)
