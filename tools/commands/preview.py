"""Make the camera's own preview of shots, as JPEG: fast, and with no package that a camera does not
have.

The picture is not rotated; its Exif orientation says which way is up. --export writes the graph
that makes the previews of all cameras with the pattern of a shot, for another ONNX runtime;
device/preview/contract.py describes its inputs and outputs.
"""

import argparse
from pathlib import Path

from ...shared import InputError, read_camera, read_dng
from ...shared.writing import write_durably
from ..batch.console import Console
from ..batch.folders import DNGS, plan, search
from ..batch.in_memory import camera_preview, check_scale
from ..batch.jobs import Job, Outcome, output_folder, planned, refuse_existing
from ..batch.journal import digest
from ..batch.order import Keep, do_kept
from ..batch.progress import StageProgress
from ..io.formats.jpg import check_quality, encode_jpeg
from .options import SCALE, add, add_file_run, add_shots, file_name, file_run, pixel_limit

USAGE = "SHOT ... -o DIR"
EXAMPLE = "panchroma preview shots -o previews --scale 2"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `panchroma preview`."""
    add_shots(parser)
    folder = "folder for STEM.jpg (subfolders are kept), created if missing"
    add(parser, "output", required=False, help=folder)
    export = "write the graph for the pattern of one SHOT; without -o nothing else"
    parser.add_argument("--export", metavar="FILE.onnx", type=file_name, help=export)
    add(parser, "scale", default=1, help=f"{SCALE} (default: 1)")
    add(parser, "quality", "recalibrate")
    add_file_run(parser, "shots")
    add(parser, "json")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Write a preview of each shot; returns the exit code."""
    check_quality(arguments.quality)
    if arguments.export is not None:
        _export(arguments, console)
    if arguments.output is None:
        if arguments.export is None:
            raise InputError("-o is missing: the folder for the previews")
        return 0
    check_scale(arguments.scale)
    camera = read_camera(arguments.camera) if arguments.camera else None
    folder = output_folder(arguments.output, dry_run=arguments.dry_run)
    run = file_run(arguments, folder, camera=arguments.camera and digest(arguments.camera))

    def work(job: Job, listener: StageProgress, keep: Keep) -> Outcome:
        mosaic = read_dng(job.source, max_pixels=pixel_limit())
        if camera is not None:
            mosaic = camera.calibrated(mosaic)
        for remark in mosaic.calibration.remarks(mosaic.metadata.focal_length):
            listener.note(f"{job.source}: {remark}")
        if run.dry_run:
            return planned(job)
        picture = camera_preview(mosaic, arguments.scale)
        jpeg = encode_jpeg(picture, mosaic.metadata, quality=arguments.quality)
        write_durably(job.output, jpeg, **keep(job.output))
        rows, columns = picture.shape[:2]
        facts = {"output": str(job.output), "width": columns, "height": rows}
        return Outcome(facts, (f"{job.output}: {columns} x {rows}",))

    files = search(arguments.shots, DNGS, output=folder)
    failed = files.report(console)
    jobs = plan(files.sources, lambda name: [f"{Path(name).stem}.jpg"], folder, dry_run=run.dry_run)
    return do_kept(run, jobs, work, console, threads=arguments.jobs) or failed


def _export(arguments: argparse.Namespace, console: Console) -> None:
    path = Path(arguments.export)
    if path.suffix != ".onnx":
        raise InputError(f"{path}: a graph has a name that ends in .onnx; write {path.stem}.onnx")
    if len(arguments.shots) > 1:
        number = f"{len(arguments.shots)} are named"
        raise InputError(f"--export writes the graph for the pattern of one shot, and {number}")
    shot = read_dng(arguments.shots[0], max_pixels=pixel_limit())
    from ...device.preview.graph import build_preview  # onnxruntime is slow to load

    graph = build_preview(shot.pattern, arguments.scale)
    if not arguments.dry_run:
        write_durably(path, graph, overwrite=arguments.overwrite)
    elif not arguments.overwrite:
        refuse_existing([path])
    console.say(f"{path}: {len(graph)} bytes")
