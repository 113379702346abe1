"""Anybody's network for Bayer mosaics: an ONNX file, and beside it a JSON file that says how it is
fed.

`Contract` documents the fields. The network is given what its authors trained it for: their order
of the filters, their packing, their code for light, white balance and the noise. None of its code
is needed.
"""

import hashlib
import json
import os
import re
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from ....shared.arrays import BORDER, ByteArray, DoubleArray, FloatArray
from ....shared.errors import InputError, meant
from ....shared.reading import naming, read_text, read_whole
from ...simulation.bayer import channel_map
from ...simulation.protocols import BayerShot
from ..cameras import Method

_ORDERS = {"RGGB": (0, 0), "GRBG": (0, 1), "GBRG": (1, 0), "BGGR": (1, 1)}
_FORMS, _FIELDS = ("quads", "sparse", "mosaic"), ("sites", "add", "noise", "crop")
_EXPECTED = (
    "an object with 'inputs', and as needed 'order', 'balanced' (true or false), 'gamma' above 0, "
    "'offset' of 0 or more, 'margin' (even, above 0)"
)
_MOST = 1e9  # of any number
_ROWS = 256  # of a chunk
_AROUND = 4.0  # pixels: standard deviation of the Gaussian over which the noise is taken for equal
_LARGEST_NETWORK = 1 << 30  # bytes of a file
# Where a tensor's values are in another file: in onnx.proto an entry of `external_data`, key
# "location", value below 128 bytes.
_OUTSIDE = re.compile(rb"\n\x08location\x12(?s:([\x01-\x7f]))")
_UNPRINTABLE = re.compile(r"[^\w .+()-]")  # in names of methods, which plots and tables show
# share of white: nearer to black the code is so steep that no network knows the noise there
_DARK = 1e-3
ENDING = ".onnx"
CHANGED = "has changed since the evaluation began; run it again"


@dataclass(frozen=True)
class Contract:
    """Inputs and outputs of a network: the fields of the JSON file.

    Attributes
    ----------
    inputs : dict[str, dict[str, Any]]
        By name, each with `form`: "quads", a plane for each of `sites`, "sparse", red, green and
        blue with zeros, or "mosaic"; as it needs them `add`, added to each plane, `noise`, whether
        the last plane is its standard deviation, and `crop`, cut off at each side.
    order : str
        Filters of its first 2 x 2 pixels.
    balanced : bool
        Samples are divided by what white reads.
    gamma, offset : float
        Code of light: (x + offset)^(1 / gamma), scaled to 0 to 1.
    margin : int
        Mirrored pixels at each side, even.
    """

    inputs: dict[str, dict[str, Any]]
    order: str = "RGGB"
    balanced: bool = True
    gamma: float = 1.0
    offset: float = 0.0
    margin: int = 64

    def __post_init__(self) -> None:
        if self.order not in tuple(_ORDERS):
            raise InputError(f"'order' is {self.order!r}, expected one of {', '.join(_ORDERS)}")
        coded = 0 < self.gamma < _MOST and 0 <= self.offset < _MOST
        odd = type(self.margin) is not int or self.margin <= 0 or self.margin % 2
        if not coded or odd or not isinstance(self.balanced, bool) or not self.inputs:
            raise InputError(f"expected {_EXPECTED}")
        for name, form in self.inputs.items():
            if form.get("form") not in _FORMS or not form.keys() <= {"form", *_FIELDS}:
                expected = f"'form' ({', '.join(_FORMS)}), {', '.join(map(repr, _FIELDS))}"
                raise InputError(f"input {name!r} is {form}, expected {expected}")

    def encode(self, signal: DoubleArray) -> DoubleArray:
        """The code of a signal, 0 to 1 for 0 to 1."""
        if self.gamma == 1:
            return signal
        low, span = self._ends
        return (np.maximum(signal + self.offset, 0) ** (1 / self.gamma) - low) / span

    def decode(self, code: DoubleArray) -> DoubleArray:
        """Inverse of `encode`."""
        if self.gamma == 1:
            return code
        low, span = self._ends
        return np.maximum(code * span + low, 0) ** self.gamma - self.offset

    def steepness(self, signal: DoubleArray) -> DoubleArray:
        """Derivative of `encode`."""
        slope = np.maximum(signal + self.offset, _DARK) ** (1 / self.gamma - 1) / self.gamma
        return slope / self._ends[1]

    @property
    def _ends(self) -> tuple[float, float]:
        """The root of black, and how far that of white is above it."""
        low = self.offset ** (1 / self.gamma)
        return low, (1 + self.offset) ** (1 / self.gamma) - low


def network(path: str) -> Method:
    """Return the method of a network, whose name is that of its file and a digest of what is in it.

    Raises InputError, which names the file that is missing or wrong and says what was expected.
    """
    description = Path(path).with_suffix(".json")
    digest = content(path)
    try:
        text = read_text(description, _LARGEST_NETWORK, "a description of a network")
        fields, names = json.loads(text), Contract.__dataclass_fields__
        if unknown := [name for name in fields if name not in names]:
            raise InputError(f"there is no field {unknown[0]!r}{meant(unknown[0], names)}")
        contract = Contract(**fields)
    except (InputError, TypeError, ValueError, AttributeError, RecursionError) as error:
        known = isinstance(error, InputError | json.JSONDecodeError)
        reason = error if known else f"expected {_EXPECTED}"
        raise InputError(f"{description}: does not say how the network is fed: {reason}") from error
    version = hashlib.sha256(f"{digest} {text}".encode()).hexdigest()[:16]
    name = printable(f"{Path(path).stem}-{version[:8]}")
    title, demosaic = f"Bayer, {name}", partial(_demosaic, path, digest, contract)
    return Method(name, title, demosaic, version, balanced=contract.balanced, source=path)


def printable(name: str) -> str:
    """Return a name with characters that plots and tables can show."""
    return _UNPRINTABLE.sub("_", name)


def _demosaic(
    path: str, digest: str, contract: Contract, shot: BayerShot, white: FloatArray
) -> FloatArray:
    """The network's picture, float32 (H, W, 3), scene units. Raises InputError, naming the file.

    The frame is mirrored at its border, and given to the network some rows at a time.

    digest: of the network's files.
    white: what white reads, (3,).
    """
    from scipy.ndimage import gaussian_filter

    white = white if contract.balanced else np.ones_like(white)
    gain = white[channel_map(shot.samples.shape)]
    level = gaussian_filter(shot.samples.astype(np.float64), _AROUND, mode="mirror")
    deviation = np.sqrt(shot.shot * level.clip(0) + shot.read**2) / gain
    codes = contract.encode(shot.samples / gain.astype(np.float64))
    noise = gaussian_filter(deviation * contract.steepness(level / float(white.mean())), _AROUND)

    (height, width), (down, right) = codes.shape, _ORDERS[contract.order]
    margin = contract.margin
    vertical, horizontal = margin + (height + down) % 2, margin + (width + right) % 2
    pads = (margin + down, vertical), (margin + right, horizontal)
    planes: list[Any] = [np.pad(it, pads, mode=BORDER).astype(np.float32) for it in (codes, noise)]
    rows, columns = planes[0].shape
    planes.append(channel_map((rows + down, columns + right))[down:, right:])
    picture = np.empty((3, rows - 2 * margin, columns - 2 * margin))
    for top in range(0, picture.shape[1], _ROWS):
        end = min(top + _ROWS, picture.shape[1])
        strips = [plane[top : end + 2 * margin] for plane in planes]
        output = _run(path, digest, contract, strips)
        asked, got = end - top + 2 * margin, output.shape[1]
        edge = margin - (asked - got) // 2  # of the margin, what the convolutions have left
        if not 0 <= edge <= margin:
            raise InputError(f"{path}: gives {got} rows for {asked}; a larger 'margin' may help")
        picture[:, top:end] = output[:, edge : edge + end - top, edge : edge + picture.shape[2]]
    picture = picture[:, down : down + height, right : right + width].transpose(1, 2, 0)
    return np.ascontiguousarray(contract.decode(picture) * white, np.float32)


def _pack(
    form: dict[str, Any], codes: FloatArray, noise: FloatArray, filters: ByteArray
) -> FloatArray:
    """One input of the network, (1, planes, h, w)."""
    planes = [codes]
    if form["form"] == "quads":
        quads = [codes[site // 2 :: 2, site % 2 :: 2] for site in form.get("sites", (0, 1, 2, 3))]
        planes, noise = quads, noise[::2, ::2]
    elif form["form"] == "sparse":
        planes = [codes * (filters == channel) for channel in range(3)]
    bias, crop = form.get("add", [0.0] * len(planes)), int(form.get("crop", 0))
    added = [plane + np.float32(value) for plane, value in zip(planes, bias, strict=True)]
    stacked = np.stack([*added, noise] if form.get("noise") else added)
    _, height, width = stacked.shape
    return np.ascontiguousarray(stacked[None, :, crop : height - crop, crop : width - crop])


def _run(path: str, digest: str, contract: Contract, strips: list[Any]) -> FloatArray:
    model = _session(path, digest)
    try:
        inputs = {name: _pack(form, *strips) for name, form in contract.inputs.items()}
        (output,) = model.run(None, inputs)
        return np.asarray(output[0], np.float32).reshape(3, *output.shape[-2:])
    except Exception as error:  # onnxruntime's errors have no common base
        raise InputError(f"{path}: does not take what its JSON file says ({error})") from error


@cache
def _session(path: str, digest: str) -> Any:
    """A session of the network, if its files still have this digest."""
    from ....shared.runtime import session

    model = session(Path(path))
    if content(path) != digest:
        raise InputError(f"{path}: {CHANGED}")
    return model


def content(path: str) -> str:
    """A digest of a file, and of the files beside it that hold its weights if it is a network's.
    Raises InputError, which names the file.
    """
    model = read(path)
    names = {model[match.end() : match.end() + match[1][0]] for match in _OUTSIDE.finditer(model)}
    beside = [str(Path(path).parent / os.fsdecode(name)) for name in sorted(names)]
    digests = (hashlib.sha256(data).digest() for data in (model, *map(read, beside)))
    return hashlib.sha256(b"".join(digests)).hexdigest()


def read(path: str) -> bytes:
    """The content of a file. Raises InputError, which names it."""
    with naming(path):
        return read_whole(path, _LARGEST_NETWORK, "a network")
