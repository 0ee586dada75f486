"""What the records of each category become: rows of plots or truth, from which items, and which are set aside."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

FOOT_PER_LEVEL = 100.0
_DAY_S = 86400.0
_TRACK, _CODE = 1 << 24, 1 << 40  # names that are no address: track numbers and Mode 3/A codes


@dataclass(frozen=True)
class Rows:
    """Rows as a report gives them, (n,) each; NaN where missing.

    `time_s`: time of day. `names`: a number a target, -1 where nothing names it (`name_of` words it). `refused`:
    records that are no measurement, with the reason; `notes`: what the reader of the rows should know of some of them.
    """

    time_s: Floats
    names: NDArray[np.int64]
    columns: Mapping[str, Floats]
    refused: tuple[tuple[str, Mask], ...]
    notes: tuple[tuple[str, Mask], ...]


@dataclass(frozen=True)
class Report:
    """How records of a category become rows of a kind of log.

    `fields`: the numbers wanted, item and field. `needs`: a sensor's records give such rows when one of these is among
    them. `columns`: names and units of what `rows` gives besides `time_s` and `target_id`.
    """

    category: int
    kind: str
    fields: Mapping[str, str]
    needs: tuple[str, ...]
    columns: tuple[str, ...]
    rows: Callable[[Mapping[str, Floats]], Rows]


SENSOR = {"sac": "010/SAC", "sic": "010/SIC"}


def name_of(number: int) -> str:
    """A target's name: its 24-bit address in hexadecimal, `T` and its track number, or `A` and its Mode 3/A code."""
    if number >= _CODE:
        return f"A{number - _CODE:04o}"
    return f"T{number - _TRACK}" if number >= _TRACK else f"{number:06X}"


def is_address(number: int) -> bool:
    """Whether the name is an aircraft's address, the same for every sensor."""
    return 0 <= number < _TRACK


_BY_TRACK = "targets without a Mode S address are named by their track number (T...)"
_BY_CODE = "targets without address and track number are named by their Mode 3/A code (A...)"
_TESTS = "simulated and test targets"
_NO_TIME = "records without a time of day"
_NO_POSITION = "records without a position"
NO_HEIGHT = "positions without any height (targets on the ground): height_m under [[logs]] in trial.toml gives it"
_PREDICTED = "positions that the sensor predicted, not measured"


def _named(v: Mapping[str, Floats], code: Floats) -> tuple[NDArray[np.int64], tuple[tuple[str, Mask], ...]]:
    """Names by address, else track number, else Mode 3/A code; and by what else than the address."""
    address, track = v["address"], v["track"]
    by_address = address > 0
    by_track = ~by_address & ~np.isnan(track)
    by_code = ~by_address & ~by_track & (code > 0)
    names = np.full(len(address), -1, np.int64)
    for chosen, numbers, base in ((by_address, address, 0), (by_track, track, _TRACK), (by_code, code, _CODE)):
        names[chosen] = numbers[chosen].astype(np.int64) + base
    return names, ((_BY_TRACK, by_track), (_BY_CODE, by_code))


def _code(v: Mapping[str, Floats]) -> Floats:
    """Mode 3/A codes that were validated and not garbled."""
    return np.where((v["invalid"] == 1) | (v["garbled"] == 1), np.nan, v["code"])


def _first(*columns: Floats) -> Floats:
    """The first of several numbers that is there."""
    found = columns[0]
    for column in columns[1:]:
        found = np.where(np.isnan(found), column, found)
    return found


def _refused(time: Floats, placed: Mask, tests: Mask, predicted: Mask | None = None) -> tuple[tuple[str, Mask], ...]:
    """The records to set aside, each for one reason."""
    left = np.ones(len(time), bool)
    found = []
    for reason, mask in (
        (_TESTS, tests),
        (_PREDICTED, np.zeros(len(time), bool) if predicted is None else predicted),
        (_NO_TIME, ~(time < _DAY_S + 1)),
        (_NO_POSITION, ~placed),
    ):
        found.append((reason, mask & left))
        left &= ~mask
    return tuple(found)


def _monoradar(v: Mapping[str, Floats]) -> Rows:
    names, notes = _named(v, _code(v))
    placed = ~np.isnan(v["range"] + v["azimuth"])
    tests = (v["simulated"] == 1) | (v["test"] == 1)
    replies = np.isnan(v["primary_level"]) & ~np.isnan(v["reply_level"])
    columns = {
        "range_nmi": v["range"],
        "azimuth_deg": v["azimuth"],
        "amplitude_dbm": _first(v["primary_level"], v["reply_level"]),
    }
    refused = _refused(v["time"], placed, tests, v["type"] == 0)
    return Rows(v["time"], names, columns, refused, (*notes, ("amplitude is that of the transponder's reply", replies)))


def _surface_tests(v: Mapping[str, Floats]) -> Mask:
    return np.asarray((v["simulated"] == 1) | (v["test"] == 1))


def _surface_plots(v: Mapping[str, Floats]) -> Rows:
    names, notes = _named(v, _code(v))
    polar = ~np.isnan(v["range"] + v["azimuth"])
    flat = ~polar & ~np.isnan(v["x"] + v["y"])
    columns = {
        "range_m": np.where(polar, v["range"], np.hypot(v["x"], v["y"])),
        "azimuth_deg": np.where(polar, v["azimuth"], np.rad2deg(np.arctan2(v["x"], v["y"])) % 360.0),
    }
    refused = _refused(v["time"], polar | flat, _surface_tests(v), v["coasted"] > 0)
    note = ("range and azimuth are those of x (east) and y (north) from the system's reference point", flat)
    return Rows(v["time"], names, columns, refused, (*notes, note))


def _surface_truth(v: Mapping[str, Floats]) -> Rows:
    names, notes = _named(v, _code(v))
    columns, placed, more = _geodetic(v["latitude"], v["longitude"], v["height"], FOOT_PER_LEVEL * v["level"])
    refused = _refused(v["time"], placed, _surface_tests(v), v["coasted"] > 0)
    return Rows(v["time"], names, columns, refused, (*notes, *more))


def _geodetic(
    latitude: Floats, longitude: Floats, height_ft: Floats, pressure_ft: Floats
) -> tuple[dict[str, Floats], Mask, tuple[tuple[str, Mask], ...]]:
    """Positions with the height above the ellipsoid, else that of the air pressure."""
    placed = (np.abs(latitude) <= 90.0) & (np.abs(longitude) <= 180.0)
    by_pressure = np.isnan(height_ft) & ~np.isnan(pressure_ft)
    height = _first(height_ft, pressure_ft)
    columns = {"latitude_deg": latitude, "longitude_deg": longitude, "height_ft": height}
    notes = (
        ("height is the flight level (air pressure): no geometric height is given", by_pressure & placed),
        (NO_HEIGHT, np.isnan(height) & placed),
    )
    return columns, placed, notes


def _adsb(v: Mapping[str, Floats]) -> Rows:
    names, _ = _named(v, np.full(len(v["address"]), np.nan))
    time = _first(v["time"], v["received"], v["sent"], v["of_day"])
    columns, placed, notes = _geodetic(
        _first(v["fine_latitude"], v["latitude"]), _first(v["fine_longitude"], v["longitude"]),
        v["height"], FOOT_PER_LEVEL * v["level"],
    )  # fmt: skip
    applicable, received, sent = (~np.isnan(v[name]) for name in ("time", "received", "sent"))
    later = (
        ("time is that of reception: the time of applicability is not given", received & ~applicable),
        ("time is that of transmission of the report: no other is given", sent & ~received & ~applicable),
    )
    refused = _refused(time, placed, (v["simulated"] == 1) | (v["test"] == 1))
    return Rows(time, names, columns, refused, (*notes, *later))


def _system_tracks(v: Mapping[str, Floats]) -> Rows:
    names, notes = _named(v, np.full(len(v["address"]), np.nan))
    pressure = FOOT_PER_LEVEL * _first(v["barometric"], v["level"])
    columns, placed, more = _geodetic(v["latitude"], v["longitude"], v["height"], pressure)
    refused = _refused(v["time"], placed, v["simulated"] == 1, v["coasted"] == 1)
    return Rows(v["time"], names, columns, refused, (*notes, *more))


_SURFACE = {
    **SENSOR, "message": "000", "time": "140", "address": "220", "track": "161/TRK", "code": "060/MODE3A",
    "garbled": "060/G", "invalid": "060/V", "simulated": "020/SIM", "test": "020/TST", "coasted": "170/CST",
}  # fmt: skip
_GEODETIC = ("latitude_deg", "longitude_deg", "height_ft")

# A category may stand here twice: the first whose `needs` a sensor's records have is taken.
REPORTS = (
    Report(48, "plots", {
        **SENSOR, "time": "140", "range": "040/RHO", "azimuth": "040/THETA", "address": "220", "track": "161/TRN",
        "code": "070/MODE3A", "garbled": "070/G", "invalid": "070/V", "reply_level": "130/SAM",
        "primary_level": "130/PAM", "type": "020/TYP", "simulated": "020/SIM", "test": "020/TST",
    }, ("range",), ("range_nmi", "azimuth_deg", "amplitude_dbm"), _monoradar),
    Report(10, "plots", {
        **_SURFACE, "range": "040/RHO", "azimuth": "040/TH", "x": "042/X", "y": "042/Y",
    }, ("range", "x"), ("range_m", "azimuth_deg"), _surface_plots),
    Report(10, "truth", {
        **_SURFACE, "latitude": "041/LAT", "longitude": "041/LON", "x": "042/X", "y": "042/Y", "height": "091",
        "level": "090/FL",
    }, ("latitude",), _GEODETIC, _surface_truth),
    Report(21, "truth", {
        **SENSOR, "time": "071", "received": "073", "sent": "077", "of_day": "030", "address": "080",
        "track": "161/TRNUM",
        "latitude": "130/LAT", "longitude": "130/LON", "fine_latitude": "131/LAT", "fine_longitude": "131/LON",
        "height": "140", "level": "145", "simulated": "040/SIM", "test": "040/TST",
    }, ("latitude", "fine_latitude"), _GEODETIC, _adsb),
    Report(62, "truth", {
        **SENSOR, "time": "070", "address": "380/ADR", "track": "040", "latitude": "105/LAT", "longitude": "105/LON",
        "height": "130", "barometric": "135/CTB", "level": "136", "simulated": "080/SIM", "coasted": "080/CST",
    }, ("latitude",), _GEODETIC, _system_tracks),
)  # fmt: skip
