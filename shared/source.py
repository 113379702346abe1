"""Digest of source code and networks, to tell versions of Panchroma apart."""

import hashlib
from contextlib import suppress
from pathlib import Path


def code_digest(root: Path, *patterns: str) -> str:
    """Digest of the modules and networks that patterns find: 16 hexadecimal digits.

    What cannot be imported does not count: hidden and unreadable files, and copies whose names are
    no names of modules. Nor does the facade, which lies elsewhere in a wheel.

    Parameters
    ----------
    root : Path
        The folder of our packages.
    patterns : str
        As `Path.glob` takes them.

    Examples
    --------
    >>> from pathlib import Path
    >>> from panchroma.shared.source import code_digest
    >>> code_digest(Path("no such folder"), "**/*.py")
    'e3b0c44298fc1c14'
    """
    total = hashlib.sha256()
    for path in sorted({path for pattern in patterns for path in root.glob(pattern)}):
        name = path.relative_to(root)
        importable = name.stem.isidentifier() or (name.suffix == ".onnx" and name.stem[0] != ".")
        folders = name.parts[:-1]
        if importable and "notebook" not in folders and all(map(str.isidentifier, folders)):
            with suppress(OSError):
                total.update(name.as_posix().encode() + b"\0")
                total.update(hashlib.sha256(path.read_bytes()).digest())
    return total.hexdigest()[:16]
