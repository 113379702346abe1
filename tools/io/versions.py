"""Versions of Panchroma and of the packages that it uses."""

import json
import platform
from contextlib import suppress
from functools import cache
from pathlib import Path
from shlex import quote

_TOLD = "numpy", "onnxruntime", "numba", "scipy", "opencv-contrib-python-headless", "rawpy"


@cache
def package_version(name: str) -> str | None:
    """Version of an installed distribution, None where it is not installed."""
    # Here: it takes longer to import than the rest of the command line, which shows a traceback
    # when it is interrupted meanwhile.
    from importlib.metadata import PackageNotFoundError, version

    with suppress(PackageNotFoundError):
        return version(name)
    return None


def program_version() -> str:
    """Version of the installed Panchroma, "unknown version" for a checkout that is not
    installed.
    """
    return package_version("panchroma") or "unknown version"


def versions() -> str:
    """Versions of Panchroma, of Python, and of the packages that make pictures, for people."""
    python = f"Python {platform.python_version()} on {platform.system()} ({platform.machine()})"
    found = ((name, package_version(name)) for name in _TOLD)
    packages = (f"{name} {version}" for name, version in found if version)
    return ", ".join([f"Panchroma {program_version()}", python, *packages])


def install_command(extra: str = "all") -> str:
    """Command that installs Panchroma with an extra ("" = without) from where this one came: the
    folder of a clone, the wheel, repository or address that pip remembers, or an index.
    """
    from importlib.metadata import PackageNotFoundError, distribution

    name, clone, origin = f"[{extra}]" if extra else "", Path(__file__).resolve().parents[2], {}
    if (clone / "pyproject.toml").is_file():
        return f"pip install -e {quote(f'{clone}{name}')}"
    with suppress(PackageNotFoundError):
        origin = json.loads(distribution("panchroma").read_text("direct_url.json") or "{}")
    url = "+".join(filter(None, (origin.get("vcs_info", {}).get("vcs"), origin.get("url"))))
    return f"pip install {quote(f'panchroma{name} @ {url}' if url else f'panchroma{name}')}"
