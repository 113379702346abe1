"""What the settings of all stages have in common."""

from dataclasses import dataclass

from shared.errors import InputError


def require(holds: bool, name: str, value: object, expected: str) -> None:
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
