"""Cameras that speak GenICam, GigE Vision and USB3 Vision, through Aravis 0.8: they say themselves
what their frames are.

Aravis is a library of the system, reached by GObject introspection, and imported in this module
only.
"""

import re
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from time import monotonic
from typing import Any

from ...device.capture.frames import FrameLayout, RawFrame, format_named
from ...shared import CaptureMetadata, CfaPattern, InputError
from ..simulation.pattern_text import read_pattern

Stopped = Callable[[], bool]
"""Polled between frames: whether to end."""
Note = Callable[[str], None]
"""Called with remarks."""
GENICAM = "genicam:"
# where python3-gi is; a virtual environment does not look there
_DEBIAN = "/usr/lib/python3/dist-packages"
_PYTHON = "make the virtual environment with the system's own Python: /usr/bin/python3"
_INSTALL = f"apt-get install gir1.2-aravis-0.8 python3-gi (and {_PYTHON})"
_SILENCE = 10.0  # seconds without a frame, beside the exposure
_POLL = 100_000  # microseconds between two looks at whether to stop
_MICROSECONDS = 1e6  # GenICam counts the exposure in them
SETTINGS = {
    "exposure_time": ("exposure_time", _MICROSECONDS),
    "gain": ("gain", 1.0),
    "fps": ("frame_rate", 1.0),
}
"""Setting of the user -> feature of Aravis, and number of its units in one of ours; the exposure
limits the frame rate.
"""


def connected() -> list[str]:
    """A line for each camera that answers: its name as a source, and what it is.

    Raises InputError without Aravis.
    """
    aravis, _ = load_aravis()
    aravis.update_device_list()
    lines = []
    for number in range(aravis.get_n_devices()):
        names = ("vendor", "model", "protocol", "address")
        facts = filter(None, (getattr(aravis, f"get_device_{name}")(number) for name in names))
        lines.append(f"{GENICAM}{aravis.get_device_id(number)}  {', '.join(facts)}")
    return lines


class GenicamCamera:
    """A connected camera, set up to send frames.

    The attributes `layout` and `bits` describe the frames, `pattern` the filters (None = the camera
    does not say), `metadata` what every shot is to record, `about` the camera in words, `lost` how
    many frames so far arrived incomplete, came too fast to be read, or not at all.

    Raises InputError without Aravis, if there is no such camera, if another program has it, and for
    what the camera cannot do.

    Parameters
    ----------
    source : str
        Genicam:ID, the name, serial number or address of a camera; see `connected`.
    pixel_format : str | None
        Its name for the camera, which is PFNC's (Mono12p, SCF1WBWG10); None = the one that the
        camera has now.
    settings : Mapping[str, float | None]
        One of SETTINGS -> its value, None = as the camera is set: exposure_time in seconds, gain in
        the camera's unit, mostly decibels, fps in frames a second.
    """

    def __init__(
        self, source: str, pixel_format: str | None, settings: Mapping[str, float | None]
    ) -> None:
        self._aravis, self._error = load_aravis()
        self._source = source
        self._closed, self._gone = threading.Event(), threading.Event()
        # held while a thread is in Aravis: none may be there when the program ends
        self._using = threading.Lock()
        self._stream: Any = None
        self._last = self.lost = 0
        with self._answers():
            self._camera = self._aravis.Camera.new(source.removeprefix(GENICAM))
            self._device = self._camera.get_device()
            if self._camera.is_gv_device() and not self._device.is_controller():
                remedy = "end it (after a crash the camera is free again in 3 seconds)"
                raise InputError(f"{source}: another program has the camera; {remedy}")
            # a reference to self would keep the camera from being freed after an error
            gone = self._gone
            self._device.connect("control-lost", lambda *_: gone.set())
            # A program that was killed may have left it sending to nobody; as long as it does, it
            # sends nothing to anybody else.
            self._camera.stop_acquisition()
            self._choose_format(pixel_format)
            for option, value in settings.items():
                if value is not None:
                    self._set(option, value)
            if self._camera.is_feature_available("AcquisitionMode"):
                self._camera.set_acquisition_mode(self._aravis.AcquisitionMode.CONTINUOUS)
            self._describe()

    def frames(self, stopped: Stopped, note: Note) -> Iterator[RawFrame]:
        """Yield the frames that arrive whole, until `stopped` returns True.

        note: called once, if none arrives for ten seconds and the exposure. Raises InputError when
        the camera is lost.
        """
        with self._answers(), self._using:
            self._stream = self._camera.create_stream(None)
            size = self._camera.get_payload()
            # Aravis fills four frames meanwhile; each is copied, and its buffer given back, as soon
            # as it is there.
            for _ in range(4):
                self._stream.push_buffer(self._aravis.Buffer.new_allocate(size))
            self._camera.start_acquisition()
        quiet = _SILENCE + (self.metadata.exposure_time or 0.0)
        whole, patience = 0, monotonic() + quiet
        while not (stopped() or self._closed.is_set()):
            frame = self._next()
            if frame is not None:
                whole, patience = whole + 1, monotonic() + quiet
                yield frame
            elif self._gone.is_set():
                reason = "it was unplugged, has no power, or another program has taken it"
                why = f"the camera is gone after {whole} whole frames: {reason}"
                raise InputError(f"{self._source}: {why}")
            elif monotonic() > patience:
                patience = float("inf")
                note(
                    f"{self._source}: no whole frame for {quiet:.0f} seconds: does it wait for a "
                    "trigger, or does a firewall or a slow network keep frames back?"
                )

    def _next(self) -> RawFrame | None:
        """The next frame; None if it does not arrive in time, or not whole."""
        with self._using:
            buffer = None if self._closed.is_set() else self._stream.timeout_pop_buffer(_POLL)
            if buffer is None:
                return None
            number, self._last = self._last, buffer.get_frame_id()
            if number:  # those left out found no buffer free; after 65535 many cameras begin anew
                self.lost += max(self._last - number - 1, 0)
            frame = None
            if buffer.get_status() == self._aravis.BufferStatus.SUCCESS:
                frame = RawFrame.now(buffer.get_image_data()[: self.layout.frame_bytes])
            self.lost += frame is None
            self._stream.push_buffer(buffer)
            return frame

    def close(self) -> None:
        """Stop the camera and let other programs have it."""
        self._closed.set()
        with self._using, suppress(self._error):  # the camera may be lost at this moment
            if not self._gone.is_set():
                self._camera.stop_acquisition()
                if self._camera.is_gv_device():
                    self._device.leave_control()
            self._stream = None

    @contextmanager
    def _answers(self) -> Iterator[None]:
        """Turn Aravis' errors into ours, which name the camera."""
        try:
            yield
        except self._error as error:
            advice = f"{GENICAM} alone lists the cameras"
            raise InputError(f"{self._source}: {error.message}; {advice}") from None

    def _choose_format(self, requested: str | None) -> None:
        """Choose the format, and read size, stride, bits and filters."""
        camera = self._camera
        name = requested or camera.get_pixel_format_as_string()
        usable = list(filter(_is_known, camera.dup_available_pixel_formats_as_strings()))
        if name not in usable:
            choice = f"choose one with `pixel_format`: {', '.join(usable)}"
            unusable = f"{self._source}: the camera's format {name!r} cannot be used"
            raise InputError(f"{unusable}; {choice if usable else 'nor can others that it offers'}")
        if requested:
            camera.set_pixel_format_from_string(requested)
        key, self.bits = format_named(name)
        roi, payload = camera.get_region(), camera.get_payload()
        self.layout = layout = FrameLayout(roi.width, roi.height, key)
        if camera.is_feature_available("LinePitch"):
            self.layout = replace(layout, stride=camera.get_integer("LinePitch"))
        elif payload % roi.height == 0 and payload > layout.frame_bytes:
            self.layout = replace(layout, stride=payload // roi.height)
        if payload < self.layout.frame_bytes:
            fault = f"a frame has {payload} bytes, but {self.layout.size}"
            raise InputError(f"{self._source}: {fault}; set a width that 8 divides")
        # PFNC: Sparse Color Filter #1, the first row of its tile, bits and packing
        filters = re.fullmatch(r"(SCF1[WRGB]{4})\d+\w*", name)
        self.pattern: CfaPattern | None = read_pattern(filters[1]) if filters else None
        self._name = name

    def _set(self, option: str, value: float) -> None:
        camera, (feature, units) = self._camera, SETTINGS[option]
        if not getattr(camera, f"is_{feature}_available")():
            raise InputError(f"{self._source}: the camera has no setting for `{option}`")
        if self._is_automatic(feature):
            getattr(camera, f"set_{feature}_auto")(self._aravis.Auto.OFF)
        lowest, highest = getattr(camera, f"get_{feature}_bounds")()
        if not lowest <= value * units <= highest:
            bounds = f"{lowest / units:g} to {highest / units:g}"
            raise InputError(f"{self._source}: `{option}` is {value:g}; the camera takes {bounds}")
        getattr(camera, f"set_{feature}")(value * units)

    def _is_automatic(self, feature: str) -> bool:
        name, camera = feature.removesuffix("_time"), self._camera
        if feature == "frame_rate" or not getattr(camera, f"is_{name}_auto_available")():
            return False
        return bool(getattr(camera, f"get_{feature}_auto")() != self._aravis.Auto.OFF)

    def _describe(self) -> None:
        """Read what the camera has made of its settings; a value that it changes by itself is left
        out.
        """
        camera = self._camera

        def read(feature: str) -> float | None:
            if not getattr(camera, f"is_{feature}_available")() or self._is_automatic(feature):
                return None
            return float(getattr(camera, f"get_{feature}")())

        time, gain, rate = (read(feature) for feature, _ in SETTINGS.values())
        node = self._device.get_feature("Gain")
        unit = (node.get_unit() or "") if hasattr(node, "get_unit") else ""
        settings = [f"gain {gain:g} {unit}".rstrip()] if gain is not None else []
        settings += [f"{rate:g} frames a second"] if rate else []
        make, model = camera.get_vendor_name() or "", camera.get_model_name() or ""
        seconds = time / _MICROSECONDS if time else None
        # As in libcamera's DNGs, the gain 1 is ISO 100; a gain of unknown unit says nothing.
        iso = round(100 * 10 ** (gain / 20)) if gain is not None and unit == "dB" else None
        known: dict[str, Any] = {"exposure_time": seconds, "iso": iso}
        self.metadata = CaptureMetadata(make, model, description=", ".join(settings), **known)
        size = f"{self.layout.width} x {self.layout.height} {self._name}"
        exposure = [f"exposure {seconds:g} s"] if seconds else []
        self.about = f"{make} {model}: " + ", ".join([size, *exposure, *settings])


def _is_known(pixel_format: str) -> bool:
    with suppress(InputError):
        return bool(format_named(pixel_format))
    return False


def load_aravis() -> tuple[Any, Any]:
    """Aravis, and the class of its errors.

    Raises InputError that says what to install.
    """
    sys.path.append(_DEBIAN)  # at the end: what the environment has itself comes first
    try:
        import gi

        gi.require_version("Aravis", "0.8")
        from gi.repository import Aravis, GLib
    except (ImportError, ValueError) as error:
        needed = f"{GENICAM} needs Aravis 0.8 and PyGObject"
        raise InputError(f"{needed} ({error}): {_INSTALL}") from None
    finally:
        sys.path.remove(_DEBIAN)
    return Aravis, GLib.Error
