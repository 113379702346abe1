"""Run the camera's software on an emulated ARM processor and compare its pictures with this
machine's, bit by bit.

    python -m tests.arm [--cpu cortex-a72 cortex-a76] [--onnxruntime 1.23.2]

Needs Debian's apt-get and dpkg-deb, qemu-aarch64 (package qemu-user) and access to the package
index. It needs no root and installs nothing: a small arm64 system and the aarch64 wheels of the
base dependencies are unpacked into the user's cache. Emulation does not show how fast a board is.
"""

import os
import re
import shutil
import sys
import tomllib
from collections.abc import Sequence
from itertools import product
from pathlib import Path

import numpy as np

from panchroma.shared.errors import InputError, OutputError, PanchromaError
from tests.benchmarks.harness import options
from tests.data import ROOT
from tests.python import finished

QEMU = "qemu-aarch64"
CPUS = ("cortex-a72", "cortex-a76")  # of the Raspberry Pi 4 and 5
_DEBIAN = ("python3-minimal", "libpython3-stdlib", "libstdc++6", "libgomp1")
# From the oldest glibc that a wheel may ask for to that of the oldest Debian that still makes sense
# on a board.
_PLATFORMS = [f"manylinux{glibc}_aarch64" for glibc in ("2014", "_2_17", "_2_27", "_2_28")]
# qemu shows the host's /proc/cpuinfo, and onnxruntime from 1.24 on dies on an ARM that has no ARM
# cores.
_CORE = (
    "processor\t: {}\nFeatures\t: fp asimd crc32 cpuid\nCPU implementer\t: 0x41\nCPU "
    "architecture: 8\nCPU part\t: 0xd08\n\n"
)


# In what apt-get and pip say without a network.
_NO_NETWORK = re.compile("resolv|connect|unreachable|timed out", re.IGNORECASE)


class UnreachableError(InputError):
    """A download is out of reach: nothing is wrong here."""


def main() -> int:
    """Exit code: 0 when every result is identical, 1 when one differs, 2 when the emulation cannot
    be run.
    """
    given, differing = options(__doc__, cpu=list(CPUS), onnxruntime=[""]), False
    for version, cpu in product(given.onnxruntime, given.cpu):
        try:
            runtime, compared, faults = check(cpu, version)
        except PanchromaError as error:
            print(f"tests.arm: {error}", file=sys.stderr)
            return 2
        differing |= bool(faults)
        identical = f"{compared - len(faults)} of {compared} identical"
        print(f"onnxruntime {runtime} on {cpu}: {identical}", *faults, sep="\n  ", flush=True)
    return int(differing)


def check(cpu: str, onnxruntime: str = "") -> tuple[str, int, list[str]]:
    """(version of onnxruntime, number of results, names of those that differ) on the emulated
    `cpu`. The results are in here.npz and there.npz of the cache.

    onnxruntime: the version to install; "": the newest.

    Raises InputError when something needed is missing and cannot be downloaded, OutputError when
    the camera's software fails.
    """
    if not shutil.which(QEMU):
        raise InputError(f"{QEMU} is not installed (Debian: apt-get install qemu-user)")
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "panchroma-arm"
    system = _system(cache)
    emulated = [QEMU, "-cpu", cpu, "-L", str(system), str(system / "usr/bin/python3")]
    site = _site(cache, emulated, onnxruntime)
    ours = [ROOT, ROOT / "tools/notebook"]
    there = _probe(emulated, [site, *ours], cache / "there.npz")
    here = _probe([sys.executable], ours, cache / "here.npz")
    names = [name for name in here if name != "onnxruntime"]
    faults = [name for name in names if here[name].tobytes() != there[name].tobytes()]
    return str(there["onnxruntime"]), len(names), faults


def _system(cache: Path) -> Path:
    """A folder with as much of an arm64 Debian as Python needs."""
    system = cache / "system"
    if (system / "usr/bin/python3").exists():
        return system
    apt = cache / "apt"
    for folder in ("lists/partial", "archives/partial"):
        (apt / folder).mkdir(parents=True, exist_ok=True)
    (apt / "status").touch()  # no package is installed there: apt-get downloads every dependency
    settings = {
        "APT::Architecture": "arm64",
        "APT::Architectures": "arm64",
        "APT::Update::Error-Mode": "any",  # without a network it would succeed
        "Dir::State::lists": apt / "lists",
        "Dir::State::status": apt / "status",
        "Dir::Cache": apt,
    }
    options = [part for name, value in settings.items() for part in ("-o", f"{name}={value}")]
    _run("apt-get", *options, "update")
    install = "install", "--download-only", "--no-install-recommends", "-y", *_DEBIAN
    _run("apt-get", *options, *install)
    unpacked = cache / "system.part"
    for package in sorted((apt / "archives").glob("*.deb")):
        _run("dpkg-deb", "-x", str(package), str(unpacked))
    (unpacked / "proc").mkdir(exist_ok=True)
    (unpacked / "proc/cpuinfo").write_text(_CORE.format(0) + _CORE.format(1))
    (unpacked / "sys/devices/system/cpu").mkdir(parents=True)
    for name in ("possible", "present"):
        (unpacked / "sys/devices/system/cpu" / name).write_text("0-1\n")
    return unpacked.rename(system)


def _site(cache: Path, python: Sequence[str], onnxruntime: str) -> Path:
    """A folder with the base dependencies, and nothing else, for the emulated Python."""
    site = cache / f"site-{onnxruntime or 'newest'}"
    if site.exists():
        return site
    wanted = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["dependencies"]
    if onnxruntime:
        wanted = [each for each in wanted if not each.startswith("onnxruntime")]
        wanted += [f"onnxruntime=={onnxruntime}"]
    version = _run(*python, "-c", "import sys; print(*sys.version_info[:2], sep='.')").strip()
    platforms = [part for platform in _PLATFORMS for part in ("--platform", platform)]
    part = site.with_suffix(site.suffix + ".part")
    shutil.rmtree(part, ignore_errors=True)
    chosen = ["--python-version", version, "--target", str(part), "--only-binary=:all:"]
    quiet = ["--no-compile", "--quiet"]
    _run(sys.executable, "-m", "pip", "install", *platforms, *chosen, *quiet, *wanted)
    return part.rename(site)


def _probe(python: Sequence[str], path: Sequence[Path], result: Path) -> dict[str, np.ndarray]:
    line, paths = [*python, "-m", "tests.arm.probe", str(result)], os.pathsep.join(map(str, path))
    _run(*line, failure=OutputError, PYTHONPATH=paths)
    with np.load(result) as arrays:
        return dict(arrays)


def _run(*command: str, failure: type[PanchromaError] = InputError, **environment: str) -> str:
    # PYTHONDONTWRITEBYTECODE: the two Pythons must not use each other's compiled files.
    quiet = {"PYTHONDONTWRITEBYTECODE": "1", "ORT_DISABLE_TELEMETRY": "1"}
    variables = {**os.environ, **quiet, **environment}
    done = finished(*command, env=variables)
    if done.returncode:
        said = done.stderr.strip().splitlines()[-1:] or [f"exit code {done.returncode}"]
        out_of_reach = failure is InputError and _NO_NETWORK.search(done.stderr)
        kind = UnreachableError if out_of_reach else failure
        raise kind(f"{' '.join(command[:6])} ...: {said[0]}")
    return done.stdout


if __name__ == "__main__":
    sys.exit(main())
