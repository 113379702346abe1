"""A method: a way from the shot of one of the two cameras to a picture."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...shared.arrays import FloatArray
from ..io.versions import package_version
from .cameras import CameraPair

_ALWAYS = ("numba", "numpy", "onnxruntime", "scipy")  # packages that make or measure pictures


@dataclass(frozen=True)
class Method:
    """A way from a shot to a picture.

    Parameters
    ----------
    name
        On the command line and in the results.
    title
        For people: the camera, a comma, the method.
    function
        Makes the picture, float32 (H, W, N), scene units: from a Mosaic if the method is for the
        sparse-colour camera; from a
        `BayerShot` and the white to balance by, float32 (3,), if it is a rival.
    version
        Digest of `source`.
    ours
        Panchroma's own, for shots of the sparse-colour camera with any pattern; otherwise a rival,
        for Bayer shots.
    balanced
        The picture depends on what white reads; if not, a rival is given ones.
    packages
        Distributions that the method needs; results depend on their versions.
    source
        Somebody's own network or function, as the user gave it; "" = none. Results depend on its
        content, which `version` states.
    """

    name: str
    title: str
    function: Callable[..., FloatArray]
    version: str = ""
    ours: bool = False
    balanced: bool = False
    packages: tuple[str, ...] = ()
    source: str = ""

    @property
    def missing(self) -> str | None:
        """A package that the method needs and that is not installed."""
        missing = (package for package in self.packages if package_version(package) is None)
        return next(missing, None)

    @property
    def identity(self) -> dict[str, Any]:
        """Dependencies of results besides scene, noise, pattern and Panchroma's own code, as JSON
        values.
        """
        packages = {name: package_version(name) for name in (*_ALWAYS, *self.packages)}
        return {"method": self.version or self.name, "packages": packages}

    def render(self, cameras: CameraPair) -> FloatArray:
        """Render the shot of the camera that this method is for.

        Returns float32 (H, W, N), scene units.
        """
        if self.ours:
            return cameras.render_sparse(self.function)
        white = cameras.white if self.balanced else np.ones_like(cameras.white)
        return self.function(cameras.bayer, white)
