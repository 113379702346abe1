"""Write the graph that makes a camera's previews, as an ONNX file: for patterns that none came along for, or another runtime.

Its inputs and outputs are described in device/contract.py. One file serves all cameras and all origins of a pattern.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from shared import CfaPattern, read_dng
from shared.errors import InputError
from shared.pattern import BAYER_ORDERS, PERIODS
from shared.writing import write_durably
from tools.host.console import Console
from tools.host.jobs import output_folder

if TYPE_CHECKING:
    from onnx import ModelProto

_SHIPPED_PERIODS = (4, 6, 8)
_PERIOD, _ORDER = 6, BAYER_ORDERS[0]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Of `panchroma export-preview`."""
    parser.add_argument("-o", "--output", required=True, metavar="FILE", help="ends in .onnx; with --all an existing folder")
    pattern = parser.add_argument_group("the pattern")
    pattern.add_argument(
        "--period", type=int, metavar="K", help=f"pixels from block to block, {PERIODS[0]} to {PERIODS[-1]} (default: {_PERIOD})"
    )
    pattern.add_argument("--order", choices=BAYER_ORDERS, help=f"filters of a block (default: {_ORDER})")
    pattern.add_argument("--like", metavar="SHOT", help="the pattern of this shot, whatever it is")
    parser.add_argument(
        "--scale",
        type=int,
        default=1,
        metavar="N",
        help="sensor pixels per pixel of the picture, each way; a divisor of the period",
    )
    parser.add_argument("--linear", action="store_true", help="camera RGB in scene units, not a picture for a screen")
    parser.add_argument("--all", action="store_true", help="all graphs that come with the program, under their names")
    parser.add_argument("--overwrite", action="store_true", help="replace results that exist")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Returns the exit code."""
    if arguments.all:
        if arguments.like or arguments.period or arguments.order or arguments.linear or arguments.scale != 1:
            raise InputError("--all writes a given set of graphs; leave the other options out")
        folder = output_folder(arguments.output)
        for name, model in shipped():
            _write(folder / name, model, arguments.overwrite, console)
        return 0
    path = Path(arguments.output)
    if path.suffix != ".onnx":
        raise InputError(f"{arguments.output}: is no name for a graph; write {path.stem}.onnx")
    _write(path, _build(_pattern(arguments), arguments.scale, linear=arguments.linear), arguments.overwrite, console)
    return 0


def shipped() -> Iterator[tuple[str, "ModelProto"]]:
    """File name and graph of everything in device/models: 2 x 2 Bayer blocks, periods 4, 6 and 8, all scales but whole patches."""
    from device.contract import file_name
    from device.geometry import Geometry

    for period in _SHIPPED_PERIODS:
        for order in BAYER_ORDERS:
            pattern = CfaPattern.bayer(period, order)
            for scale in Geometry.scales(pattern)[:-1]:
                for linear in (False, True)[: 2 if scale == 1 else 1]:
                    yield file_name(pattern, scale, linear=linear), _build(pattern, scale, linear=linear)


def _pattern(arguments: argparse.Namespace) -> CfaPattern:
    if not arguments.like:
        return CfaPattern.bayer(_PERIOD if arguments.period is None else arguments.period, arguments.order or _ORDER)
    if arguments.period is not None or arguments.order:
        raise InputError("--like takes the pattern of a shot; leave --period and --order out")
    return read_dng(arguments.like).pattern


def _build(pattern: CfaPattern, scale: int, *, linear: bool) -> "ModelProto":
    try:
        from device.graph import build_preview
    except ImportError:
        raise InputError("graphs are built with the package onnx, which is not installed; pip install 'panchroma[tools]'") from None
    return build_preview(pattern, scale, linear=linear)


def _write(path: Path, model: "ModelProto", overwrite: bool, console: Console) -> None:
    data = model.SerializeToString(deterministic=True)
    write_durably(path, data, overwrite=overwrite)
    console.say(f"{path}: {len(model.graph.node)} nodes, {len(data)} bytes")
