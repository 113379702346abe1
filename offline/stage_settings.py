"""What the settings of all stages have in common, and the settings of stages that are used or not."""

from dataclasses import dataclass

from shared.errors import InputError


def require(holds: bool, name: str, value: object, expected: str) -> None:
    """Raise InputError, which names a setting, its value and what is expected, unless this holds."""
    if not holds:
        raise InputError(f"settings: {name} is {value}, expected {expected}")


class StageSettings:
    """Base of the settings of a stage: whether it is used, and which kernels it then calls, to compile them ahead."""

    @property
    def used(self) -> bool:
        """Whether the stage changes anything."""
        return True

    @property
    def kernels(self) -> tuple[str, ...]:
        """Names of the kernels that it calls when it is used; stages in rows say so themselves."""
        return ()


@dataclass(frozen=True)
class Switch(StageSettings):
    """A stage that is used or not. used: whether it is."""

    used: bool = False


@dataclass(frozen=True)
class SettlingSettings(Switch):
    """Correction of luminance at the colour sites once the colour of blocks is known (see `sites`); not in the paper."""

    kernels = "share_out", "smooth"


@dataclass(frozen=True)
class LineSettings(Switch):
    """Colour as a linear function of luminance, where that explains the samples (see `whole.colour_lines`); not in the paper."""

    kernels = "surroundings", "smooth"


@dataclass(frozen=True)
class TrustSettings(Switch):
    """Blocks whose samples do not add up to luminance take the colour of their neighbours (see `whole.trust`); not in the paper.

    tolerance: how far the samples of a block may differ from luminance, relative to it, before half of its chromaticity is that of
        its neighbours, > 0.
    """

    kernels = "surroundings", "smooth"

    tolerance: float = 0.4

    def __post_init__(self) -> None:
        require(self.tolerance > 0, "trust.tolerance", self.tolerance, "more than 0")


OFF, NO_LINES, NOT_SETTLED, ALL_TRUSTED = Switch(), LineSettings(), SettlingSettings(), TrustSettings()
