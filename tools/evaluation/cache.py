"""Results on disk, called by what they depend on: an interrupted run goes on, and a new method adds only itself."""

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shared.errors import InputError, OutputError
from shared.writing import write_durably

from .measures import Measures

FOLDER = "results"
_FORMAT = 2


def key(**parts: Any) -> str:
    """The name of a result: a digest of everything it depends on (JSON values)."""
    text = json.dumps({"format": _FORMAT, **parts}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


@dataclass(frozen=True)
class Cache:
    """The results in one folder, a file each, written whole or not at all."""

    folder: Path

    def get(self, name: str) -> Measures | None:
        """A result, or None when it is not there or not whole."""
        try:
            return Measures.decode(self._path(name).read_bytes())
        except (OSError, InputError):
            return None

    def has(self, name: str) -> bool:
        """Whether there is a file of that name."""
        return self._path(name).exists()

    def put(self, name: str, measures: Measures) -> None:
        """Keep a result. Raises OutputError as `write_durably` does."""
        try:
            self.folder.mkdir(exist_ok=True)
        except OSError as error:
            raise OutputError(f"{self.folder}: the folder cannot be made ({error.strerror or error})") from None
        write_durably(self._path(name), measures.encode(), overwrite=True)

    def _path(self, name: str) -> Path:
        return self.folder / f"{name}.npz"
