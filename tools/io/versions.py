"""Versions of Panchroma and of the packages that it uses."""

from contextlib import suppress
from functools import cache


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
