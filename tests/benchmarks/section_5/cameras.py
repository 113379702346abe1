"""Cameras with other filters, photographing one scene under the same light."""

import string
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from shared import CfaPattern, Mosaic
from shared.arrays import FloatArray
from tools.camera.filters import Filters, filters_for
from tools.camera.protocols import Protocol
from tools.camera.simulated_camera import SimulatedCamera
from tools.scenes.scene import Scene


def photographed(block: str, period: int, scene: Scene, level: Protocol) -> tuple[Mosaic, Filters]:
    """A shot, which knows no colours, and the filters. block: rows separated by "/"; there is one in every `period` pixels."""
    letters = "".join(sorted(set(block) - set("/W"), key=("RGB" + string.ascii_uppercase).index))
    pattern = CfaPattern.with_block(tuple(block.split("/")), period, channels=letters)
    filters = filters_for(pattern, scene)
    camera = SimulatedCamera.of(pattern, protocol=level.scaled(filters.unit), bits=level.bits)
    plain = replace(scene, camera_to_xyz=None, neutral=None)
    return camera.shoot(plain, np.random.default_rng(0)).mosaic, filters


def rendered(block: str, period: int, scene: Scene, level: Protocol, method: Callable[[Mosaic], FloatArray]) -> FloatArray:
    """The shot as rendered by a method, in the scene's channels by the (pseudo-)inverse of the filters, as bright as the scene."""
    shot, filters = photographed(block, period, scene, level)
    return method(shot) / np.float32(level.light) @ np.linalg.pinv(np.array(filters.matrix)).T.astype(np.float32)
