"""Cameras with other filters, photographing one scene under the same light."""

import string

from shared import CfaPattern
from tools.camera.protocols import Protocol
from tools.evaluation.cameras import CameraPair
from tools.scenes.scene import Scene


def camera(block: str, period: int, scene: Scene, level: Protocol) -> CameraPair:
    """A camera in front of a scene. block: rows separated by "/"; there is one in every `period` pixels."""
    letters = "".join(sorted(set(block) - set("/W"), key=("RGB" + string.ascii_uppercase).index))
    pattern = CfaPattern.with_block(tuple(block.split("/")), period, channels=letters)
    return CameraPair(level, 0, scene.rgb, pattern, None, channels=scene.channels)
