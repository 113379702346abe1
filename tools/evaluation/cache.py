"""Results kept on disk under a digest of all they depend on, so that an interrupted run continues where it stopped."""

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from shared.errors import InputError, OutputError
from shared.writing import own_file, write_durably

T = TypeVar("T")

FOLDER = "results"


MEASURING = 1
"""Version of the way from the light of a scene to figures: cameras, noise, filters, measures. Raise it whenever figures change.

A result is kept under versions: this one, those of the protocol and of the method (of ours: of the renderer and its settings, or of
the preview), and those of the packages that the method needs. Whoever changes code so that figures differ raises the number beside
it, or the old figures stay; a test compares figures with those that the numbers stand for.
"""


def key(**parts: Any) -> str:
    """Name of a result: a digest of everything it depends on besides MEASURING (JSON values)."""
    return hashlib.sha256(json.dumps({"measuring": MEASURING, **parts}, sort_keys=True).encode()).hexdigest()[:32]


@dataclass(frozen=True)
class Cache:
    """The results in one folder, one file each."""

    folder: Path

    def get(self, name: str, decode: Callable[[bytes], T]) -> T | None:
        """What `decode` makes of the file of this name; None when there is no such file, or it is damaged (`decode` raises)."""
        try:
            with own_file(self.folder / name, "rb") as file:
                return decode(file.read())
        except (OSError, ValueError, TypeError, InputError):
            return None

    def put(self, name: str, data: bytes) -> None:
        """Keep a result; the file is complete or absent. Raises OutputError as `write_durably` does."""
        try:
            self.folder.mkdir(exist_ok=True)
        except OSError as error:
            raise OutputError(f"{self.folder}: the folder cannot be made ({error.strerror or error})") from None
        write_durably(self.folder / name, data, overwrite=True)
