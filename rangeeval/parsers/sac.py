"""SAC waveform files of an infrasound or seismic array: one file a sensor, all of them one snapshots log.

A header of 158 words of four bytes (70 floats, 40 integers, 192 bytes of text), then evenly spaced samples; either byte
order. Sensors are placed north, east and up of their middle by the latitudes and longitudes in the headers, so bearings
come out clockwise from north, towards the source (back azimuth). Times count from the first common sample.

The layout is that of the SAC manual, header versions 6 and 7. `docs/explanation/decisions.md` says why no package reads
these files here.
"""

from __future__ import annotations

import contextlib
import datetime
import math
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rangeeval.errors import InputError, one_line
from rangeeval.model import Problem, SensorArray
from rangeeval.parsers.blocks import Contents, SourceFile
from rangeeval.parsers.samples import ReadRows, Recorded, snapshots_log

HEADER_BYTES = 632
_UNDEFINED = -12345.0
_TIME_SERIES = 1
_FOOTER_BYTES = {6: 0, 7: 22 * 8}
# Words of the header, counted from 0.
_DELTA, _BEGIN, _LATITUDE, _LONGITUDE, _ELEVATION = 0, 5, 31, 32, 33
_YEAR, _VERSION, _COUNT, _KIND, _EVEN = 70, 76, 79, 85, 105
_STATION = slice(440, 448)


@dataclass(frozen=True)
class _Channel:
    """One file: its samples and where its sensor stood (None where its header does not say)."""

    file: SourceFile
    order: str
    count: int
    interval_s: float
    start: datetime.datetime
    place: tuple[float, float, float] | None
    station: str


def recognises(head: bytes, path: Path) -> bool:
    """A header of SAC's version 6 or 7, in either byte order, with a count, an interval and a flag that can be."""
    return _order(head) is not None


def _order(head: bytes) -> str | None:
    if len(head) < HEADER_BYTES:
        return None
    for order in "<>":
        version, count, even = (struct.unpack_from(f"{order}i", head, 4 * w)[0] for w in (_VERSION, _COUNT, _EVEN))
        interval = struct.unpack_from(f"{order}f", head, 4 * _DELTA)[0]
        if version in _FOOTER_BYTES and count > 0 and even in (0, 1) and math.isfinite(interval) and interval > 0:
            return order
    return None


def read(file: SourceFile) -> Contents:
    """The log of one file: an array of one sensor."""
    return read_together([file])


def read_together(files: Sequence[SourceFile]) -> Contents:
    """The log of the files of an array, over the time that all of them cover.

    Raises InputError for a damaged file, for files of different sampling rates, and when no time is common to all.
    """
    channels = [_channel(file) for file in files]
    first = channels[0]
    where = first.file.name + (f":{len(files)} files" if len(files) > 1 else "")
    for channel in channels:
        if not math.isclose(channel.interval_s, first.interval_s, rel_tol=1e-6):
            raise InputError(
                f"{channel.file.name}: is sampled at {1 / channel.interval_s:g} Hz and {first.file.name} at "
                f"{1 / first.interval_s:g} Hz; the sensors of one array have one sampling rate"
            )
    begin = max(channel.start for channel in channels)
    ahead = [(begin - channel.start).total_seconds() / channel.interval_s for channel in channels]
    skipped = [round(samples) for samples in ahead]
    rows = min(channel.count - skip for channel, skip in zip(channels, skipped, strict=True))
    if rows <= 0:
        raise InputError(f"{where}: the files have no time in common")
    problems = []
    apart = max(abs(a - s) for a, s in zip(ahead, skipped, strict=True)) * first.interval_s
    if apart > 1e-3 * first.interval_s:
        problems.append(Problem(where, f"the sensors were sampled up to {apart * 1e3:.3g} ms apart; not corrected"))
    lost = max(channel.count for channel in channels) - rows
    if lost:
        problems.append(Problem(where, "samples outside the time common to all sensors are not read", lost))

    @contextlib.contextmanager
    def opened() -> Iterator[ReadRows]:
        with contextlib.ExitStack() as stack:
            streams = [stack.enter_context(channel.file.path.open("rb")) for channel in channels]

            def read_rows(start: int, stop: int) -> tuple[None, NDArray[np.float64]]:
                samples = np.empty((stop - start, len(channels)))
                for i, (channel, stream) in enumerate(zip(channels, streams, strict=True)):
                    stream.seek(HEADER_BYTES + 4 * (skipped[i] + start))
                    data = stream.read(4 * (stop - start))
                    if len(data) < 4 * (stop - start):
                        raise InputError(f"{channel.file.name}: was cut off while it was read")
                    with np.errstate(invalid="ignore"):  # a NaN that signals becomes one that does not
                        samples[:, i] = np.frombuffer(data, f"{channel.order}f4")
                return None, samples

            yield read_rows

    said = SensorArray(
        sensor_position_m=_positions(channels),
        sampling_rate_hz=1 / round(first.interval_s, 9),
        time_zero=begin.isoformat(timespec="milliseconds").replace("+00:00", "Z"),
        sensors=tuple(channel.station or channel.file.path.stem for channel in channels),
        bearings="compass",
    )
    recorded = Recorded(where, rows, len(channels), opened, said)
    return Contents((snapshots_log(recorded, first.file),), tuple(problems))


def _channel(file: SourceFile) -> _Channel:
    size = file.path.stat().st_size
    with file.path.open("rb") as stream:
        head = stream.read(HEADER_BYTES)
    order = _order(head)
    assert order is not None  # it was recognised
    floats = struct.unpack_from(f"{order}70f", head)
    whole = struct.unpack_from(f"{order}40i", head, 280)
    integer = {70 + i: value for i, value in enumerate(whole)}
    count, expected = integer[_COUNT], HEADER_BYTES + 4 * integer[_COUNT] + _FOOTER_BYTES[integer[_VERSION]]
    if size != expected:
        what = "is cut off" if size < expected else "is damaged"
        raise InputError(f"{file.name}: {what}: it declares {count} samples in {expected} bytes and has {size}")
    if integer[_EVEN] != 1 or integer[_KIND] != _TIME_SERIES:
        raise InputError(f"{file.name}: is not an evenly sampled time series, the one kind of SAC file that is read")
    return _Channel(
        file, order, count, floats[_DELTA], _start(file, integer, floats[_BEGIN]), _place(floats),
        one_line(head[_STATION].split(b"\0")[0].decode("ascii", "replace").strip(), 8),
    )  # fmt: skip


def _start(file: SourceFile, integer: dict[int, int], begin_s: float) -> datetime.datetime:
    """The time of the first sample; the start of 1970 where the header does not say."""
    year, day, hour, minute, second, millisecond = (integer[_YEAR + i] for i in range(6))
    begin_s = 0.0 if begin_s == _UNDEFINED or not math.isfinite(begin_s) else begin_s
    if _UNDEFINED in (year, day):
        year, day, hour, minute, second, millisecond = 1970, 1, 0, 0, 0, 0
    clock = [0 if part == _UNDEFINED else part for part in (hour, minute, second, millisecond)]
    try:
        return datetime.datetime(year, 1, 1, tzinfo=datetime.UTC) + datetime.timedelta(
            days=day - 1, hours=clock[0], minutes=clock[1], seconds=clock[2] + begin_s, milliseconds=clock[3]
        )
    except (ValueError, OverflowError):
        raise InputError(f"{file.name}: is damaged: its header gives no possible time") from None


def _place(floats: Sequence[float]) -> tuple[float, float, float] | None:
    latitude, longitude, height = floats[_LATITUDE], floats[_LONGITUDE], floats[_ELEVATION]
    if not (abs(latitude) <= 90 and abs(longitude) <= 360):
        return None
    return latitude, longitude, height if math.isfinite(height) and height != _UNDEFINED else 0.0


def _positions(channels: Sequence[_Channel]) -> tuple[tuple[float, ...], ...]:
    """North, east and up of the sensors' middle; none when a header does not give its place."""
    from rangeeval.physics.geodesy import north_up_east

    places = [channel.place for channel in channels]
    if None in places:
        return ()
    geodetic = np.array(places, dtype=np.float64)
    latitude, longitude = np.deg2rad(geodetic[:, 0]), np.deg2rad(geodetic[:, 1])
    middle = (float(latitude.mean()), float(longitude.mean()), float(geodetic[:, 2].mean()))
    north, up, east = north_up_east(latitude, longitude, geodetic[:, 2], middle).T
    return tuple(map(tuple, np.round(np.column_stack([north, east, up]), 4).tolist()))
