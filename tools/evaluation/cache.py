"""Results kept on disk under a digest of all they depend on, so that an interrupted run continues where it stopped."""

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from shared.arrays import DoubleArray
from shared.errors import InputError, OutputError
from shared.writing import own_file, write_durably

from .measures import Measures

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

    def get(self, name: str) -> Measures | None:
        """The result of this name; None when there is no such file or it is damaged."""
        try:
            with own_file(self._path(name), "rb") as file:
                return Measures.decode(file.read())
        except (OSError, InputError):
            return None

    def numbers(self, name: str, shape: tuple[int, ...]) -> DoubleArray | None:
        """The numbers kept under this name; None when there is no such file, or it does not hold so many finite ones."""
        try:
            with own_file(self._path(name, "json"), "rb") as file:
                found: DoubleArray = np.array(json.loads(file.read()), float)
        except (OSError, ValueError, TypeError):
            return None
        return found if found.shape == shape and np.isfinite(found).all() else None

    def put_numbers(self, name: str, numbers: DoubleArray) -> None:
        """Keep numbers, like `put`."""
        self._write(self._path(name, "json"), json.dumps(numbers.tolist()).encode())

    def put(self, name: str, measures: Measures) -> None:
        """Keep a result; the file is complete or absent. Raises OutputError as `write_durably` does."""
        self._write(self._path(name), measures.encode())

    def _write(self, path: Path, data: bytes) -> None:
        try:
            self.folder.mkdir(exist_ok=True)
        except OSError as error:
            raise OutputError(f"{self.folder}: the folder cannot be made ({error.strerror or error})") from None
        write_durably(path, data, overwrite=True)

    def _path(self, name: str, ending: str = "npz") -> Path:
        return self.folder / f"{name}.{ending}"
