"""The private record of a DNG (DNGPrivateData): pattern and calibration as JSON, which survives
edits by other programs.

The record names the samples it belongs to, by their size and digest. So neither can be exchanged
for those of another shot.
"""

import hashlib
import json
from dataclasses import asdict, dataclass
from typing import Any

from ..calibration import OPTIONAL, SensorCalibration
from ..errors import InputError
from ..figures import parsed_json, size
from ..mosaic import Mosaic
from ..pattern import CfaPattern
from .reader import damaged
from .tags import MAKER

SCHEMA = 1
RECORD = "the record of pattern and calibration (DNGPrivateData)"
"""Its name in messages."""
# DNG requires a NUL-terminated ASCII text that begins with the name of the maker; our bytes follow
# it.
RECORD_ID = f"{MAKER} mosaic".encode() + b"\0"


@dataclass(frozen=True)
class Record:
    """The content of a record.

    Attributes
    ----------
    pattern, calibration : CfaPattern, SensorCalibration
        Of the mosaic.
    id : str
        Digest of all of it, 16 hexadecimal digits; RawDataUniqueID repeats it, so that no other
        record takes its place.
    shape : tuple[int, int]
        (rows, columns) of the samples the record belongs to.
    samples : str
        NewRawImageDigest of these samples, hexadecimal.
    preview : str
        Digest of the JPEG preview, hexadecimal.
    """

    pattern: CfaPattern
    calibration: SensorCalibration
    id: str
    shape: tuple[int, int]
    samples: str
    preview: str


def encode_record(mosaic: Mosaic, samples: bytes, preview: bytes) -> tuple[bytes, str]:
    """The content of DNGPrivateData, RECORD_ID, then a JSON object in UTF-8; and its `Record.id`.

    Parameters
    ----------
    samples : bytes
        NewRawImageDigest of the mosaic's codes.
    preview : bytes
        The JPEG preview.
    """
    pattern, calibration = mosaic.pattern, mosaic.calibration.to_json()
    document = {
        "schema": SCHEMA,
        "shape": mosaic.shape,
        "samples": samples.hex(),
        "preview": preview_digest(preview),
        "pattern": {**asdict(pattern), "period": pattern.period},
        # They stand beside the calibration.
        **{name: calibration.pop(name) for name in OPTIONAL if name in calibration},
        "calibration": calibration,
        "calibration_id": mosaic.calibration.id,
    }
    identity = document["digest"] = _digest(document)
    text = json.dumps(document, ensure_ascii=False).encode(errors="backslashreplace")
    return RECORD_ID + text, identity


def decode_record(data: bytes) -> Record:
    """The content of a record.

    Raises
    ------
    InputError
        When it has changed, or a newer Panchroma wrote it.
    """
    changed = damaged(f"{RECORD} is not what was written")
    try:
        document = parsed_json(data[len(RECORD_ID) :].rstrip(b"\0"))
    except InputError as error:
        raise changed from error
    digest = document.pop("digest", None) if isinstance(document, dict) else None
    if not isinstance(digest, str) or digest != _digest(document):
        raise changed
    if (schema := document.get("schema")) != SCHEMA:
        known = f"this version reads {SCHEMA}; update it"
        raise InputError(f"the record of pattern and calibration has schema {schema!r}, {known}")
    stated = [document.get(name) for name in ("pattern", "calibration", "samples", "preview")]
    kinds = zip(stated, (dict, dict, str, str), strict=True)
    if not all(isinstance(value, kind) for value, kind in kinds):
        raise changed  # the digest is right, but no version of ours wrote this
    tile, calibration, *digests = stated
    tile.pop("period", None)
    calibration |= {name: document[name] for name in document.keys() & OPTIONAL}
    pattern, shape = CfaPattern.from_json(tile), size("shape", document.get("shape"))
    return Record(pattern, SensorCalibration.from_json(calibration), digest, shape, *digests)


def preview_digest(jpeg: bytes) -> str:
    """Digest of a preview, 32 hexadecimal digits."""
    return hashlib.sha256(jpeg).hexdigest()[:32]


def _digest(document: dict[str, Any]) -> str:
    """Digest of the content, 16 hexadecimal digits; independent of the order of keys and of white
    space.
    """
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()[:16]
