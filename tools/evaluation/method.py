"""What a method is: a way from the shot of one of the two cameras to a picture."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from shared.arrays import FloatArray
from tools.io.versions import package_version

from .cameras import CameraPair, Denoise, with_balance

_EXTRAS = {"bm3d": "rivals", "demosaicnet": "learned-rivals", "torch": "learned-rivals"}
"""Packages that another extra of ours than `evaluation` installs."""


@dataclass(frozen=True)
class Method:
    """A way from a shot to a picture.

    title: name for people.
    function: makes the picture, from a Mosaic if the method is for any pattern, from Bayer samples if it is not.
    version: of the code of the method, a JSON value. Kept results are used while it stays: raise it whenever its pictures change.
    ours: whether it is Panchroma's.
    sparse: whether it renders shots of the sparse-colour camera, of any pattern.
    balanced: a rival that gets white-balanced samples.
    denoise: applied to a rival's samples first.
    whole_shot: whether a rival's function gets the `BayerShot`, with its noise, and what white reads, instead of the samples.
    packages: distributions that it needs; results depend on their versions, too.
    seconds: rough duration per megapixel, from which the time left is estimated.
    file: of a network; "" = none. Results depend on its content, which `version` tells, not on its name.
    """

    name: str
    title: str
    function: Callable[..., FloatArray]
    version: Any = 1
    ours: bool = False
    sparse: bool = False
    balanced: bool = False
    denoise: Denoise | None = None
    whole_shot: bool = False
    packages: tuple[str, ...] = ()
    seconds: float = 1.0
    file: str = ""

    @property
    def short(self) -> str:
        """Title without the name of the sensor."""
        return self.title.partition(", ")[2] or self.title

    @property
    def missing(self) -> str | None:
        """A package that the method needs and that is not installed."""
        return next((package for package in self.packages if package_version(package) is None), None)

    @property
    def remedy(self) -> str:
        """The command that installs what the method needs."""
        return f"pip install -e '.[{_EXTRAS.get(self.missing or '', 'evaluation')}]'"

    @property
    def identity(self) -> dict[str, Any]:
        """What results depend on besides scene, noise and pattern, as JSON values."""
        packages = {each: package_version(each) for each in self.packages}
        return {"method": "network" if self.file else self.name, "version": self.version, "packages": packages}

    def with_balance(self) -> "Method":
        """The same method, given white-balanced samples."""
        return replace(self, name=f"{self.name}-wb", title=f"{self.title.rpartition(' ')[0]}, balanced", balanced=True)

    def render(self, cameras: CameraPair) -> FloatArray:
        """Render the shot of the camera that this method is for. Returns float32 (H, W, N), scene units."""
        if self.sparse:
            return cameras.render_sparse(self.function)
        shot, white = cameras.denoised(self.denoise) if self.denoise else cameras.bayer, cameras.white
        if self.whole_shot:
            return self.function(shot, white)
        return with_balance(self.function, shot.samples, white) if self.balanced else self.function(shot.samples)
