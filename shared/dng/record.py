"""Our own record in a DNG: pattern and calibration in full, as JSON that survives other programs' edits (DNGPrivateData)."""

import hashlib
import json
from typing import Any

from ..calibration import SensorCalibration
from ..errors import InputError
from ..mosaic import Mosaic
from ..pattern import CfaPattern
from .reader import damaged
from .tags import MAKER

SCHEMA = 1
# DNG wants an ASCII text, NUL-terminated, that begins with the maker's name; then come our bytes.
RECORD_ID = f"{MAKER} mosaic".encode() + b"\0"


def encode_record(mosaic: Mosaic) -> bytes:
    """The content of DNGPrivateData: RECORD_ID, then one JSON object in UTF-8."""
    pattern = mosaic.pattern
    document = {
        "schema": SCHEMA,
        "pattern": {"tile": pattern.tile, "period": pattern.period, "origin": pattern.origin, "channels": pattern.channels},
        "calibration": mosaic.calibration.to_json(),
        "calibration_id": mosaic.calibration.id,
    }
    return RECORD_ID + json.dumps({**document, "digest": _digest(document)}, ensure_ascii=False).encode()


def is_record(data: bytes) -> bool:
    """Whether DNGPrivateData is ours."""
    return data.startswith(RECORD_ID)


def decode_record(data: bytes) -> tuple[CfaPattern, SensorCalibration]:
    """Inverse of `encode_record`; raises InputError when a byte of it has changed, or a newer Panchroma wrote it."""
    try:
        document = json.loads(data[len(RECORD_ID) :].rstrip(b"\0"))
        digest = document.pop("digest")
        whole = digest == _digest(document)
    except (ValueError, AttributeError, KeyError, TypeError, RecursionError):
        whole = False
    if not whole:
        raise damaged("the record of pattern and calibration (DNGPrivateData) is not what was written")
    if (schema := document.get("schema")) != SCHEMA:
        raise InputError(f"the record of pattern and calibration has schema {schema!r}, this version reads {SCHEMA}; update it")
    given = document["pattern"]
    row, column = given["origin"]
    return CfaPattern(tuple(given["tile"]), (row, column), given["channels"]), SensorCalibration.from_json(document["calibration"])


def _digest(document: dict[str, Any]) -> str:
    """Sixteen digits over the content, not over its spelling."""
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()[:16]
