"""The protocols of noise. A new one is a subclass of `Protocol` in a file of its own, and a line in `PROTOCOLS`."""

from collections.abc import Mapping
from typing import TypeVar

from shared.errors import InputError

from .paper import PaperProtocol
from .protocol import Protocol
from .sensor import SensorProtocol

__all__ = ["PROTOCOLS", "PaperProtocol", "Protocol", "SensorProtocol", "chosen_protocol"]

PROTOCOLS: dict[str, type[Protocol]] = {each.name: each for each in (PaperProtocol, SensorProtocol)}

Given = TypeVar("Given")


def chosen_protocol(name: str | None, levels: Mapping[str, Given | None]) -> tuple[type[Protocol], Given | None]:
    """The protocol that is asked for, and the level or levels that are given for it; None where its own default is meant.

    name: in PROTOCOLS; None = that of the level which is given, or else the paper's.
    levels: what is given under the names of the protocols' levels (`Protocol.option`).
    Raises InputError for an unknown protocol, for the level of another one, and for levels of two.
    """
    given = [option for option, level in levels.items() if level is not None]
    if name is None:
        if len(given) > 1:
            raise InputError(f"{' and '.join(f'`{option}`' for option in given)} set different kinds of noise; give one of them")
        name = next((each.name for each in PROTOCOLS.values() if each.option in given), PaperProtocol.name)
    if name not in PROTOCOLS:
        raise InputError(f"`protocol` is {name!r}, expected one of {', '.join(PROTOCOLS)}")
    chosen = PROTOCOLS[name]
    if others := [option for option in given if option != chosen.option]:
        raise InputError(
            f"`{others[0]}` is not a level of `protocol` {name}, whose noise is set by `{chosen.option}`; give the one or the other"
        )
    return chosen, levels.get(chosen.option)
