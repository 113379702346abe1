"""Versions of Panchroma and of the packages that it uses."""

from functools import cache
from importlib.metadata import PackageNotFoundError, version


@cache
def package_version(name: str) -> str | None:
    """Version of an installed distribution, None where it is not installed."""
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def program_version() -> str:
    """Version of the installed Panchroma, "unknown version" for a checkout that is not installed."""
    return package_version("panchroma") or "unknown version"
