"""Simulated shots that state other things than the simulated camera does."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from shared import CaptureMetadata, read_dng
from tests.tools.calibration.known_camera import save, stating
from tests.tools.command import run


def taken(folder: Path, name: str, source: str, *options: str, focal: float | None = None, **facts: Any) -> Path:
    """Simulate a source in `folder/true`, and save the shot as `folder/name`, where its calibration states other facts."""
    run("simulate", source, "-o", folder / "true", "--overwrite", "--protocol", "sensor", *options, code=0)
    shot = read_dng(folder / "true" / f"{source.replace(':', '-')}.dng")
    return save(folder / name, replace(stating(shot, **facts), metadata=CaptureMetadata(focal_length=focal)))
