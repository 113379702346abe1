"""The build of setuptools, for copies whose links are whole.

`tools/notebook/panchroma` holds links to the folders at the top. They are made where they are
missing; where Git or an archive has put files in their place (Windows), a package would be
installed that cannot be imported, so the build ends.
"""

from pathlib import Path
from typing import Any

from setuptools import build_meta

for _name in ("device", "offline", "shared", "tools"):
    _link = Path(__file__).parent / "panchroma" / _name
    if not _link.exists():  # as in a source distribution
        _link.symlink_to(Path("../../..", _name))
    if not (_link / "__init__.py").is_file():
        raise SystemExit(
            f"{_link} should be a link to the folder {_name} at the top: this copy of the sources "
            "was made without symbolic links. Clone again with `git clone -c core.symlinks=true`, "
            "on Windows inside the Windows Subsystem for Linux"
        )


def __getattr__(name: str) -> Any:
    return getattr(build_meta, name)  # the hooks of PEP 517 and PEP 660
