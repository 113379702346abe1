"""Make the camera's own picture of shots, as a JPEG: at once, and with no more than a camera has installed.

It lies as the samples do; the Exif orientation says which way is up.
"""

import argparse
import time
from pathlib import Path
from typing import Any

from shared import read_camera, read_dng
from shared.tiff import encode_tiff
from shared.writing import write_durably
from tools.host.console import Console
from tools.host.jobs import Job, add_limit, output_folder, plan, run_jobs
from tools.pictures.encoders import encode_jpeg
from tools.pictures.exif_writing import jpeg_directory
from tools.pictures.previews import Previews, add_graph_option


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Of `panchroma preview`."""
    parser.add_argument("shots", nargs="+", metavar="SHOT", help="a DNG of Panchroma")
    parser.add_argument("-o", "--output", required=True, metavar="DIR", help="existing folder for STEM.jpg")
    parser.add_argument(
        "--scale",
        type=int,
        default=1,
        metavar="N",
        help="sensor pixels per pixel of the picture, each way; a divisor of the period",
    )
    add_graph_option(parser)
    parser.add_argument("--camera", metavar="FILE", help="camera.json to use instead of the calibration in the shots")
    add_limit(parser)
    parser.add_argument("--overwrite", action="store_true", help="replace results that exist")
    parser.add_argument("--json", action="store_true", help="one object per shot on stdout")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Returns the exit code."""
    folder = output_folder(arguments.output)
    previews = Previews(arguments.scale, arguments.graph)
    camera = read_camera(arguments.camera) if arguments.camera else None

    def work(job: Job) -> dict[str, Any]:
        (output,) = job.outputs
        mosaic = read_dng(job.source, max_pixels=arguments.max_pixels)
        if camera is not None:
            mosaic = camera.calibrated(mosaic)
        start = time.monotonic()
        picture = previews(mosaic)
        milliseconds = (time.monotonic() - start) * 1e3
        exif = encode_tiff(jpeg_directory(mosaic.metadata, picture.shape, srgb=True))
        write_durably(output, encode_jpeg(picture, icc=b"", exif=exif), overwrite=arguments.overwrite)
        rows, columns = picture.shape[:2]
        console.say(f"{output}: {columns} x {rows}, {milliseconds:.0f} ms")
        return {"output": str(output), "width": columns, "height": rows, "preview_ms": round(milliseconds, 1)}

    jobs = plan(arguments.shots, lambda source: [f"{Path(source).stem}.jpg"], folder)
    return run_jobs(jobs, work, console, overwrite=arguments.overwrite)
