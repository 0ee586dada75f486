"""The kinds of log and their columns: one literal table that parsers, checks and documentation read."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Column:
    """One column of a log kind: its stored (SI) name, its unit, and whether it is a number or a label.

    A `wide` column holds an array of numbers a row, real or complex: one a sensor.
    """

    name: str
    unit: str = "1"
    required: bool = False
    text: bool = False
    about: str = ""
    wide: bool = False


@dataclass(frozen=True)
class LogKind:
    """What the rows of a log are, and which columns it has.

    `any_of`: at least one of these columns must be there besides the required ones. `instead_of`: stored columns
    that another spelling of the same quantity replaces (direction sines for `y`, `z`; `alpha`, `beta` for all
    three axes).
    """

    name: str
    row: str
    columns: tuple[Column, ...]
    any_of: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """The stored names of all columns."""
        return tuple(c.name for c in self.columns)

    @property
    def required(self) -> tuple[str, ...]:
        """The stored names of the columns that must be there."""
        return tuple(c.name for c in self.columns if c.required)

    def column(self, name: str) -> Column:
        """The column of that stored name (KeyError when there is none)."""
        for c in self.columns:
            if c.name == name:
                return c
        raise KeyError(name)

    def missing(self, present: Iterable[str]) -> tuple[str, ...]:
        """Which columns a table with the stored names `present` lacks to be of this kind."""
        have = set(present)
        lacking = tuple(n for n in self.required if n not in have)
        if self.any_of and have.isdisjoint(self.any_of):
            lacking += (" or ".join(self.any_of),)
        return lacking


def _c(name: str, unit: str = "1", about: str = "", *, required: bool = False, text: bool = False) -> Column:
    return Column(name, unit, required, text, about)


TIME = _c("time_s", "s", "time of the row", required=True)
TRACK = _c("track_id", about="which track", text=True)
TARGET = _c("target_id", about="which target", text=True)

_GAINS = (
    *(
        _c(f"{gain}_{axis}", about=f"filter gain {gain} of the {axis} axis")
        for axis in ("range", "y", "z")
        for gain in ("alpha", "beta")
    ),
    _c("alpha", about="alpha of all three axes"),
    _c("beta", about="beta of all three axes"),
)
GAIN_COLUMNS = tuple(c.name for c in _GAINS)

_SINES = (
    "sin_elevation_residual",
    "sin_azimuth_residual",
    "sin_elevation_predicted",
    "sin_azimuth_predicted",
)

RESIDUALS = LogKind(
    "residuals",
    "one track-filter update",
    (
        TIME,
        TRACK,
        _c("range_residual_m", "m", "measured minus predicted range"),
        _c("y_residual_m", "m", "measured minus predicted y (up along the array face)"),
        _c("z_residual_m", "m", "measured minus predicted z (right along the array face)"),
        _c("range_predicted_m", "m", "predicted range", required=True),
        _c("y_predicted_m", "m", "predicted y"),
        _c("z_predicted_m", "m", "predicted z"),
        *(_c(name, about="direction sine, times predicted range it is y or z") for name in _SINES),
        _c("snr_db", "db", "signal-to-noise ratio of the update"),
        _c("waveform", about="waveform in use", text=True),
        _c("attenuation_db", "db", "attenuator state"),
        *_GAINS,
        _c("nis", about="normalised innovation squared of the update"),
        *(_c(f"mode_{i}_probability", about=f"probability of model {i} of an IMM filter") for i in range(1, 5)),
    ),
    any_of=(
        "range_residual_m",
        "y_residual_m",
        "z_residual_m",
        "sin_elevation_residual",
        "sin_azimuth_residual",
    ),
)

GAINS = LogKind(
    "gains",
    "the filter gains of one update",
    (TIME, TRACK, *_GAINS),
    any_of=("alpha", "alpha_range", "alpha_y", "alpha_z"),
)

SENSORS = ("upper", "lower", "middle", *(f"sensor_{i}" for i in range(1, 10)))

TILT = LogKind(
    "tilt",
    "one accelerometer sample",
    (
        TIME,
        *(
            _c(f"{place}_{axis}_accel_m_s2", "m_s2", f"{place.replace('_', ' ')} accelerometer, {about}")
            for axis, about in (
                ("x", "reading of the x rotation (roll)"),
                ("z", "reading of the z rotation (pitch)"),
                ("y", "reading along the vertical, which checks the unit"),
            )
            for place in SENSORS
        ),
    ),
    any_of=tuple(f"{place}_{axis}_accel_m_s2" for axis in ("x", "z") for place in SENSORS),
)

DETECTIONS = LogKind(
    "detections",
    "one look (dwell or scan) at one target",
    (
        TIME,
        TARGET,
        _c("detected", about="1 detected, 0 missed", required=True),
        _c("amplitude", about="power over mean noise power, linear; missing when not detected"),
        _c("snr_per_m2", "per_m2", "mean SNR of a 1 m^2 target (alpha_k)"),
        _c("threshold", about="detection threshold, same unit as amplitude"),
        _c("false_alarm_probability", about="probability of a false alarm in the look"),
        _c("range_m", "m", "range of the look"),
        _c("aspect_rad", "rad", "aspect angle of the target"),
        _c("pulses", about="pulses integrated in the look"),
        _c("energy_db", "db", "transmitted energy of the look against the nominal"),
        _c("loss_db", "db", "loss of the look: beam shape, scan, straddle"),
    ),
)

PLOTS = LogKind(
    "plots",
    "one measured position",
    (
        TIME,
        TARGET,
        _c("range_m", "m", "measured range", required=True),
        _c("azimuth_rad", "rad", "measured azimuth, clockwise from north", required=True),
        _c("elevation_rad", "rad", "measured elevation"),
        _c("snr_db", "db", "signal-to-noise ratio"),
        _c("amplitude_dbm", "dbm", "received level"),
    ),
)

TRUTH = LogKind(
    "truth",
    "one surveyed position",
    (
        TIME,
        TARGET,
        _c("latitude_deg", "deg", "geodetic latitude, WGS 84"),
        _c("longitude_deg", "deg", "longitude, WGS 84"),
        _c("height_m", "m", "height above the ellipsoid"),
        _c("north_m", "m", "north of the site"),
        _c("up_m", "m", "above the site"),
        _c("east_m", "m", "east of the site"),
        _c("bearing_rad", "rad", "bearing from the array, from its x axis towards its y axis"),
        *(
            _c(f"{axis}_velocity_m_s", "m_s", f"velocity {about}")
            for axis, about in (("north", "to the north"), ("up", "upwards"), ("east", "to the east"))
        ),
        *(
            _c(f"covariance_{a}_{b}_m2", "m2", f"covariance of {a} and {b}")
            for a, b in (
                ("north", "north"),
                ("north", "up"),
                ("north", "east"),
                ("up", "up"),
                ("up", "east"),
                ("east", "east"),
            )
        ),
    ),
    any_of=("latitude_deg", "north_m", "bearing_rad"),
)

SAMPLES = Column("samples", "1", required=True, about="what each sensor received, complex or real", wide=True)
SNAPSHOTS = LogKind("snapshots", "one array sample", (TIME, SAMPLES))

KINDS: dict[str, LogKind] = {k.name: k for k in (RESIDUALS, GAINS, TILT, DETECTIONS, PLOTS, TRUTH, SNAPSHOTS)}

_RECOGNISED_BY: dict[str, frozenset[str]] = {
    # The columns that no other kind has; a log belongs to the first kind one of whose marks it carries.
    "residuals": frozenset(c.name for c in RESIDUALS.columns if "residual" in c.name or "predicted" in c.name),
    "gains": frozenset(GAIN_COLUMNS),
    "tilt": frozenset(TILT.names) - {"time_s"},
    "detections": frozenset({"detected", "snr_per_m2"}),
    "truth": frozenset({"latitude_deg", "longitude_deg", "north_m", "up_m", "east_m", "bearing_rad"}),
    "plots": frozenset({"range_m", "azimuth_rad"}),
    "snapshots": frozenset({"samples"}),
}


def recognise(present: Iterable[str]) -> LogKind | None:
    """Which kind of log has these stored columns, judged by the columns only one kind has; None when no kind fits.

    A log can be recognised and still lack a required column: ask `LogKind.missing`.
    """
    have = set(present)
    for name, marks in _RECOGNISED_BY.items():
        if have & marks:
            return KINDS[name]
    return None
