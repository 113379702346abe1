"""A method: a way from the shot of one of the two cameras to a picture."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ...shared.arrays import FloatArray
from ..io.versions import package_version
from .cameras import CameraPair


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
        `BayerShot` and what white reads, float32 (3,), if it is a rival.
    version
        Version of the method's code, a JSON value. Kept results are used while it stays: raise it
        whenever pictures change.
    ours
        Panchroma's own, for shots of the sparse-colour camera with any pattern; otherwise a rival,
        for Bayer shots.
    balanced
        The picture depends on what white reads.
    packages
        Distributions that the method needs; results depend on their versions.
    file
        Path of a network; "" = none. Results depend on its content, which `version` states.
    """

    name: str
    title: str
    function: Callable[..., FloatArray]
    version: Any = 1
    ours: bool = False
    balanced: bool = False
    packages: tuple[str, ...] = ()
    file: str = ""

    @property
    def missing(self) -> str | None:
        """A package that the method needs and that is not installed."""
        missing = (package for package in self.packages if package_version(package) is None)
        return next(missing, None)

    @property
    def identity(self) -> dict[str, Any]:
        """Dependencies of results besides scene, noise and pattern, as JSON values."""
        packages = {package: package_version(package) for package in self.packages}
        name = "network" if self.file else self.name
        return {"method": name, "version": self.version, "packages": packages}

    def render(self, cameras: CameraPair) -> FloatArray:
        """Render the shot of the camera that this method is for.

        Returns
        -------
        FloatArray
            Float32 (H, W, N), scene units.
        """
        if self.ours:
            return cameras.render_sparse(self.function)
        return self.function(cameras.bayer, cameras.white)
