"""Write the graph that makes a camera's previews as an ONNX file: for a pattern without a built-in graph, or for another runtime.

device/contract.py describes its inputs and outputs. One file serves all cameras with this pattern, at any origin.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from shared import CfaPattern, read_dng
from shared.errors import InputError
from shared.pattern import BAYER_ORDERS
from shared.writing import write_durably
from tools.host.console import Console
from tools.host.jobs import output_folder

from .options import add, names_pattern, pattern_of

if TYPE_CHECKING:
    from onnx import ModelProto

_SHIPPED_PERIODS = (4, 6, 8)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `panchroma export-preview`."""
    parser.add_argument(
        "-o", "--output", required=True, metavar="FILE", help="ends in .onnx; with --all a folder, created if missing"
    )
    pattern = parser.add_argument_group("the pattern")
    add(pattern, "pattern", "period")
    pattern.add_argument("--like", metavar="SHOT", help="use the pattern of this shot")
    add(parser, "scale", default=1)
    parser.add_argument(
        "--space", choices=("srgb", "camera"), default="srgb", help="srgb: a picture for a screen; camera: camera RGB, scene units"
    )
    parser.add_argument("--all", action="store_true", help="write all graphs that come with the program, under their names")
    add(parser, "overwrite")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Write one graph, or all; returns the exit code."""
    if arguments.all:
        if arguments.like or names_pattern(arguments) or arguments.space != "srgb" or arguments.scale != 1:
            raise InputError("--all writes a fixed set of graphs; leave the other options out")
        folder = output_folder(arguments.output)
        for name, model in shipped():
            _write(folder / name, model, arguments.overwrite, console)
        return 0
    path = Path(arguments.output)
    if path.suffix != ".onnx":
        raise InputError(f"{arguments.output}: a graph has a name that ends in .onnx; write {path.stem}.onnx")
    _write(path, _build(_pattern(arguments), arguments.scale, linear=arguments.space == "camera"), arguments.overwrite, console)
    return 0


def shipped() -> Iterator[tuple[str, "ModelProto"]]:
    """(file name, graph) of everything in device/models: Bayer blocks, periods 4, 6 and 8, every scale below the period."""
    from device.preview.contract import file_name
    from device.preview.geometry import Geometry

    for period in _SHIPPED_PERIODS:
        for order in BAYER_ORDERS:
            pattern = CfaPattern.bayer(period, order)
            for scale in Geometry.scales(pattern)[:-1]:
                for linear in (False, True)[: 2 if scale == 1 else 1]:
                    yield file_name(pattern, scale, linear=linear), _build(pattern, scale, linear=linear)


def _pattern(arguments: argparse.Namespace) -> CfaPattern:
    if not arguments.like:
        return pattern_of(arguments)
    if names_pattern(arguments):
        raise InputError("--like takes the pattern of a shot; leave --pattern and --period out")
    return read_dng(arguments.like).pattern


def _build(pattern: CfaPattern, scale: int, *, linear: bool) -> "ModelProto":
    try:
        from device.preview.graph import build_preview
    except ImportError:
        raise InputError("graphs are built with the package onnx, which is not installed: pip install -e '.[all]'") from None
    return build_preview(pattern, scale, linear=linear)


def _write(path: Path, model: "ModelProto", overwrite: bool, console: Console) -> None:
    data = model.SerializeToString(deterministic=True)
    write_durably(path, data, overwrite=overwrite)
    console.say(f"{path}: {len(model.graph.node)} nodes, {len(data)} bytes")
