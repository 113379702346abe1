"""What the settings of all stages have in common."""

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


ON, OFF, NOT_SETTLED = Switch(used=True), Switch(), SettlingSettings()
