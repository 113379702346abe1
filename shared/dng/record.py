"""The private record of a DNG (DNGPrivateData): pattern and calibration as JSON, which survives edits by other programs."""

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
# DNG requires a NUL-terminated ASCII text that begins with the name of the maker; our bytes follow it.
RECORD_ID = f"{MAKER} mosaic".encode() + b"\0"


def encode_record(mosaic: Mosaic) -> bytes:
    """The content of DNGPrivateData: RECORD_ID, then a JSON object in UTF-8."""
    pattern = mosaic.pattern
    document = {
        "schema": SCHEMA,
        "pattern": {"tile": pattern.tile, "period": pattern.period, "origin": pattern.origin, "channels": pattern.channels},
        "calibration": mosaic.calibration.to_json(),
        "calibration_id": mosaic.calibration.id,
    }
    return RECORD_ID + json.dumps({**document, "digest": _digest(document)}, ensure_ascii=False).encode(errors="backslashreplace")


def is_record(data: bytes) -> bool:
    """Whether DNGPrivateData was written by `encode_record`."""
    return data.startswith(RECORD_ID)


def decode_record(data: bytes) -> tuple[CfaPattern, SensorCalibration]:
    """Pattern and calibration in a record. Raises InputError when its content has changed, or a newer Panchroma wrote it."""
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
    """Digest of the content, 16 hexadecimal digits; independent of the order of keys and of white space."""
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()[:16]
