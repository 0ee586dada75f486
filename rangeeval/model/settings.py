"""What `trial.toml` may say, as frozen dataclasses: an unknown key is an error that names the nearest known one."""

from __future__ import annotations

import datetime
import math
import types
import typing
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, replace
from typing import Any

from rangeeval.errors import SettingsError, did_you_mean, one_line
from rangeeval.model.kinds import KINDS, SENSORS
from rangeeval.model.records import RecordField, record_fields


@dataclass(frozen=True)
class About:
    """What the trial was. Free text, Unicode, never trusted as markup."""

    name: str = ""
    date: str = ""
    radar: str = ""
    handling: str = ""
    software: str = ""
    description: str = ""


@dataclass(frozen=True)
class Site:
    """Where the radar stood and how its antenna face was turned."""

    latitude_deg: float | None = None
    longitude_deg: float | None = None
    height_m: float = 0.0
    heading_deg: float = 0.0
    tilt_deg: float = 0.0


@dataclass(frozen=True)
class Radar:
    """The radar's parameters, all optional: used for the predicted curves."""

    bandwidth_hz: float | None = None
    beamwidth_elevation_deg: float | None = None
    beamwidth_azimuth_deg: float | None = None
    monopulse_slope: float = 1.6
    update_interval_s: float | None = None
    range_floor_m: float = 0.0
    elevation_floor_deg: float = 0.0
    azimuth_floor_deg: float = 0.0
    association_gate_sigmas: float | None = None


@dataclass(frozen=True)
class Attitude:
    """Where the accelerometers sit, the gravity they feel, and how well all that is known.

    Radii are distances from the rotation axis along the sensors' line, signed: positive on one side (below), negative
    on the other. `radius_m` names further sensors, or one axis of a sensor (`upper_x`). `spacing_m` is the upper radius
    less the lower: enough where an oscillation can show the rest. The `*_sigma_*`, `sway_m` and `time_skew_s` are
    standard deviations for the error budget. `assumed_*` is the attitude that the radar's own reports took for granted.
    """

    radius_upper_m: float | None = None
    radius_lower_m: float | None = None
    radius_middle_m: float | None = None
    radius_m: Mapping[str, float] = field(default_factory=dict)
    spacing_m: float | None = None
    gravity_m_s2: float | None = None
    single_sensor: str | None = None
    assumed_x_deg: float = 0.0
    assumed_z_deg: float = 0.0
    radius_sigma_m: float = 0.01
    bias_sigma_m_s2: float = 0.01
    time_skew_s: float = 0.001
    sway_m: float = 0.001
    gravity_sigma_m_s2: float = 0.0005


@dataclass(frozen=True)
class DetectionSettings:
    """What the amplitudes of a detections log are; the defaults are the contract's (power over mean noise power).

    `amplitude`: `signal-plus-noise` (z: noise alone has mean 1 a pulse) or `signal` (z - 1: noise subtracted).
    `integrated`: amplitude and threshold are the `sum` or the `mean` over the pulses. `saturation`: the amplitude, a
    ratio in the log's own sense, from which the receiver saturates. `gate_cells`: the amplitude is the strongest of so
    many cells. `fold_aspect`: left and right side together.
    """

    amplitude: str = "signal-plus-noise"
    pulses: int = 1
    integrated: str = "sum"
    saturation: float | None = None
    gate_cells: int = 1
    threshold: float | None = None
    false_alarm_probability: float | None = None
    fold_aspect: bool = False
    sphere_radius_m: float | None = None


@dataclass(frozen=True)
class RadarEquation:
    """How alpha (the mean SNR of 1 m^2) follows from range: the loop gain, or what it is made of.

    `calibration_db`: the standard error of alpha, common to all looks; it is reported apart from the intervals.
    """

    loop_gain_db: float | None = None
    energy_j: float | None = None
    gain_transmit_db: float | None = None
    gain_receive_db: float | None = None
    wavelength_m: float | None = None
    noise_temperature_k: float = 290.0
    noise_figure_db: float = 0.0
    loss_db: float = 0.0
    attenuation_db_per_km: float = 0.0
    calibration_db: float | None = None


@dataclass(frozen=True)
class SensorArray:
    """The array behind a `snapshots` log: what the file says of it, over which `trial.toml` has the last word.

    `sensor_position_m`: a row a sensor, x, y and perhaps z (up). A bearing is counted from the x axis towards the y
    axis, to where the signal comes from. `y_axis`: whether y lies to the `right` or the `left` of x, seen from above;
    `heading_deg`: where x points, clockwise from north. With both a bearing is shown as a `compass` one, else as that
    of the `array`. `sampling_rate_hz` stands in for `time_s`. Real samples are broad-band: taken apart into the
    frequencies of `band_hz`, over blocks of `block_s`. `pattern`: what one element hears over the angle from where it
    faces (`facing_deg`; outwards by default), `omnidirectional`, `cosine` to a power, or a `baffle` that leaves
    `pattern_back` behind it. `sector_deg`: where sources can be.
    """

    sensor_position_m: tuple[tuple[float, ...], ...] = ()
    frequency_hz: float | None = None
    propagation_speed_m_s: float | None = None
    sampling_rate_hz: float | None = None
    start_time_s: float = 0.0
    time_zero: str = ""
    sensors: tuple[str, ...] = ()
    conjugate: bool = False
    targets: int | None = None
    start_bearing_deg: tuple[float, ...] = ()
    start_rate_deg_s: tuple[float, ...] = ()
    band_hz: tuple[float, ...] = ()
    block_s: float | None = None
    y_axis: str = "right"
    heading_deg: float = 0.0
    bearings: str = "array"
    pattern: str = "omnidirectional"
    pattern_exponent: float = 1.0
    pattern_back: float = 0.1
    facing_deg: tuple[float, ...] = ()
    elevation_deg: float = 0.0
    sector_deg: tuple[float, ...] = ()

    def over(self, other: SensorArray) -> SensorArray:
        """This one, with what it leaves open taken from another."""
        given = {f.name: getattr(self, f.name) for f in fields(self) if getattr(self, f.name) != f.default}
        return replace(other, **given)


UNKNOWN_ARRAY = SensorArray()


@dataclass(frozen=True)
class TruthSettings:
    """How plots are compared with truth.

    `max_gap_s`: points of the truth farther apart leave a gap (default: five of its usual intervals, a second at
    least). `gate_m`: how near a target whose name no path has must be to a path. `time_offset_s`: how much later than
    the plots' clock the truth's is read. `max_speed_m_s`: a position that can't be reached below this speed is a jump.
    """

    max_gap_s: float | None = None
    gate_m: float | None = None
    time_offset_s: float = 0.0
    max_speed_m_s: float = 2000.0


@dataclass(frozen=True)
class ReplaySettings:
    """How recorded plots are run through a tracking filter; the command line's options go before these.

    `range_sigma_m`, `azimuth_sigma_deg`, `elevation_sigma_deg`: measurement noise (default: estimated from the plots
    themselves). `association`: `id`, `nearest`, `global` or `pda` (default: by target_id where the log has it, else
    global). `process_noise_m_s2`, `turn_noise_rad_s`, `turn_prior_rad_s`: of the filter's models, one value a model.
    `transition`: rows of the IMM's matrix per `reference_interval_s`. `alpha`, `beta`: gains of range, y, z instead of
    those of the tracking index of `design_acceleration_m_s2`. `face`: `target` (an antenna that turns to each target),
    or `site` (a face fixed by [site] heading_deg and tilt_deg). `gate_probability`, `restart_after`, `restart_gap_s`:
    when a plot is not believed, and when a track starts anew. `detection_probability`, `clutter_per_m3`: of `pda`.
    `ospa_cutoff_m`: of OSPA and GOSPA.
    """

    filter: str | None = None
    range_sigma_m: float | None = None
    azimuth_sigma_deg: float | None = None
    elevation_sigma_deg: float | None = None
    association: str | None = None
    process_noise_m_s2: tuple[float, ...] = ()
    turn_noise_rad_s: float | None = None
    turn_prior_rad_s: float | None = None
    transition: tuple[tuple[float, ...], ...] = ()
    reference_interval_s: float | None = None
    alpha: tuple[float, ...] = ()
    beta: tuple[float, ...] = ()
    design_acceleration_m_s2: float | None = None
    face: str = "target"
    gate_probability: float | None = None
    restart_after: int | None = None
    restart_gap_s: float | None = None
    detection_probability: float = 0.9
    clutter_per_m3: float | None = None
    max_speed_m_s: float = 1000.0
    ospa_cutoff_m: float = 500.0


VARIABLES = ("range", "azimuth", "elevation", "snr", "aspect", "time")


@dataclass(frozen=True)
class BinSettings:
    """How estimates are binned, in the variable's stored unit; `snr_span_db` makes bins of constant SNR span."""

    variable: str = "range"
    width: float | None = None  # 5000 m for range
    start: float = 0.0
    min_samples: int = 30
    snr_span_db: float | None = None


@dataclass(frozen=True)
class Requirement:
    """One requirement: `quantity` must not exceed `limit` at `confidence`, in the samples that `when` selects."""

    quantity: str
    limit: float
    confidence: float = 0.95
    when: Mapping[str, float] = field(default_factory=dict)
    name: str = ""


@dataclass(frozen=True)
class LogSettings:
    """How to read a file whose columns or dialect are not the standard ones.

    `fields` make it a binary log of fixed records: those of `record_bytes` (default: what the fields take), after
    `header_bytes`.
    The last five are of ASTERIX recordings: the edition of a category (`CAT021`), the one sensor to read (`SAC/SIC`),
    the height of positions that give none (targets on the ground), and the point that x and y count from.
    """

    file: str
    kind: str | None = None
    delimiter: str | None = None
    decimal: str = "."
    skip_rows: int = 0
    encoding: str | None = None
    fields: tuple[RecordField, ...] = ()
    header_bytes: int = 0
    record_bytes: int | None = None
    columns: Mapping[str, str] = field(default_factory=dict)
    residual_stage: str = "predicted"
    editions: Mapping[str, str] = field(default_factory=dict)
    sensor: str | None = None
    height_m: float | None = None
    latitude_deg: float | None = None
    longitude_deg: float | None = None


@dataclass(frozen=True)
class TrialSettings:
    """All of `trial.toml`."""

    trial: About = About()
    site: Site = Site()
    radar: Radar = Radar()
    attitude: Attitude = Attitude()
    detections: DetectionSettings = DetectionSettings()
    radar_equation: RadarEquation = RadarEquation()
    array: SensorArray = SensorArray()
    truth: TruthSettings = TruthSettings()
    replay: ReplaySettings = ReplaySettings()
    bins: BinSettings = BinSettings()
    requirements: tuple[Requirement, ...] = ()
    logs: tuple[LogSettings, ...] = ()


def _kind_of(hint: Any) -> str:
    for wanted, name in (
        (bool, "true or false"),
        (int, "a whole number"),
        (float, "a number"),
        (str, "text"),
    ):
        if hint is wanted or (isinstance(hint, types.UnionType) and wanted in typing.get_args(hint)):
            return name
    return "a table"


def _value(value: Any, hint: Any, where: str) -> Any:
    """Check one TOML value against a field's type; numbers must be finite."""
    if isinstance(hint, types.UnionType):  # `float | None`: TOML has no null
        hint = next(a for a in typing.get_args(hint) if a is not types.NoneType)
    if is_dataclass(hint):
        return _table(value, typing.cast(type, hint), where)
    if hint == tuple[RecordField, ...]:
        return record_fields(value, where)
    origin = typing.get_origin(hint)
    if origin is tuple:
        item = typing.get_args(hint)[0]
        if not isinstance(value, list):
            wanted = "an array of tables ([[...]])" if is_dataclass(item) else "an array ([..., ...])"
            raise SettingsError(f"{where}: is {one_line(value, 40)!r}, expected {wanted}")
        return tuple(_value(v, item, f"{where}[{i}]") for i, v in enumerate(value))
    if origin is not None:  # Mapping[str, X]
        if not isinstance(value, dict):
            raise SettingsError(f"{where}: is {one_line(value, 40)!r}, expected a table")
        item = typing.get_args(hint)[1]
        return {k: _value(v, item, f"{where}.{k}") for k, v in value.items()}
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if hint is str and isinstance(value, (datetime.date, datetime.time)):
        value = value.isoformat()
    if not isinstance(value, hint) or (isinstance(value, bool) and hint is not bool):
        raise SettingsError(f"{where}: is {one_line(repr(value), 40)}, expected {_kind_of(hint)}")
    if isinstance(value, float) and not math.isfinite(value):
        raise SettingsError(f"{where}: is {value}, expected a finite number")
    return value


def _table(data: Any, shape: type, where: str) -> Any:
    """Build a settings dataclass from a TOML table; the first unknown or missing key is an error."""
    if not isinstance(data, dict):
        raise SettingsError(f"{where}: is {one_line(repr(data), 40)}, expected a table")
    hints = typing.get_type_hints(shape)
    known = {f.name: f for f in fields(shape)}
    values: dict[str, Any] = {}
    for key, value in data.items():
        if key not in known:
            raise SettingsError(f"{where}: unknown key '{one_line(key, 60)}'; {did_you_mean(key, known)}")
        values[key] = _value(value, hints[key], f"{where}.{key}" if ": " in where else f"{where}: {key}")
    for name, f in known.items():
        if name not in values and f.default is MISSING and f.default_factory is MISSING:
            raise SettingsError(f"{where}: the key '{name}' is missing")
    return shape(**values)


def settings_from(data: Mapping[str, Any], where: str = "trial.toml") -> TrialSettings:
    """Settings from a parsed `trial.toml`. Raises SettingsError naming the file, the key and the nearest known name."""
    settings = typing.cast(TrialSettings, _table(dict(data), TrialSettings, where))
    _check(settings, where)
    return settings


def _check(settings: TrialSettings, where: str) -> None:
    bins = settings.bins
    if bins.variable not in VARIABLES:
        raise SettingsError(
            f"{where}: bins.variable is '{one_line(bins.variable, 40)}'; {did_you_mean(bins.variable, VARIABLES)}"
        )
    if bins.width is None and bins.variable != "range":
        unit = {"snr": "dB", "time": "s"}.get(bins.variable, "rad")
        raise SettingsError(
            f"{where}: bins.width is missing: bins of {bins.variable} have no usual width, give it in {unit}"
        )
    if bins.width is not None and bins.width <= 0:
        raise SettingsError(f"{where}: bins.width is {bins.width:g}, expected more than 0")
    if bins.snr_span_db is not None and (bins.snr_span_db <= 0 or bins.variable != "range"):
        raise SettingsError(f'{where}: bins.snr_span_db must be more than 0, and goes with variable = "range"')
    if bins.snr_span_db is not None and bins.start <= 0:
        raise SettingsError(
            f"{where}: bins.start must be more than 0 with bins.snr_span_db (the first bin starts there)"
        )
    for i, requirement in enumerate(settings.requirements):
        at = f"{where}: requirements[{i}]"
        if not 0.5 <= requirement.confidence < 1:
            raise SettingsError(f"{at}.confidence is {requirement.confidence:g}, expected 0.5 or more and less than 1")
        for key in requirement.when:
            if not key.endswith(("_min", "_max")):
                raise SettingsError(f"{at}.when: '{one_line(key, 60)}' ends neither in _min nor in _max")
    for i, log in enumerate(settings.logs):
        at = f"{where}: logs[{i}]"
        if log.kind is not None and log.kind not in KINDS:
            raise SettingsError(f"{at}.kind is '{one_line(log.kind, 40)}'; {did_you_mean(log.kind, KINDS)}")
        if log.decimal not in {".", ","}:
            raise SettingsError(f"{at}.decimal is '{one_line(log.decimal, 10)}', expected '.' or ','")
        if log.delimiter is not None and (len(log.delimiter) != 1 or log.delimiter == log.decimal):
            raise SettingsError(
                f"{at}.delimiter is '{one_line(log.delimiter, 10)}', expected one character, not the decimal sign"
            )
        if log.skip_rows < 0:
            raise SettingsError(f"{at}.skip_rows is {log.skip_rows}, expected 0 or more")
        if log.residual_stage not in {"predicted", "updated"}:
            raise SettingsError(
                f"{at}.residual_stage is '{one_line(log.residual_stage, 40)}'; known: predicted, updated"
            )
        _check_records(log, at)
    _check_detections(settings, where)
    _check_array(settings.array, where)
    radar = settings.radar
    for name in (
        "bandwidth_hz",
        "beamwidth_elevation_deg",
        "beamwidth_azimuth_deg",
        "monopulse_slope",
        "update_interval_s",
    ):
        value = getattr(radar, name)
        if value is not None and value <= 0:
            raise SettingsError(f"{where}: radar.{name} is {value:g}, expected more than 0")
    _check_attitude(settings.attitude, where)


_OF_TEXT = ("delimiter", "decimal", "skip_rows", "encoding")


def _check_records(log: LogSettings, at: str) -> None:
    defaults = {f.name: f.default for f in fields(LogSettings)}
    if not log.fields:
        for key in ("header_bytes", "record_bytes"):
            if getattr(log, key) != defaults[key]:
                raise SettingsError(f"{at}.{key} goes with fields, the list of what a binary record holds")
        return
    for key in _OF_TEXT:
        if getattr(log, key) != defaults[key]:
            instead = "; header_bytes is what stands before the first record" if key == "skip_rows" else ""
            raise SettingsError(f"{at}.{key} is for a text log, and fields make it a binary one{instead}")
    if log.header_bytes < 0:
        raise SettingsError(f"{at}.header_bytes is {log.header_bytes}, expected 0 or more")
    needed = sum(field.bytes for field in log.fields)
    if log.record_bytes is not None and not needed <= log.record_bytes <= 1 << 20:
        raise SettingsError(
            f"{at}.record_bytes is {log.record_bytes}, expected {needed} (what the fields take) to 1048576"
        )


def _check_detections(settings: TrialSettings, where: str) -> None:
    d, e = settings.detections, settings.radar_equation
    for key, known in (("amplitude", ("signal-plus-noise", "signal")), ("integrated", ("sum", "mean"))):
        value = getattr(d, key)
        if value not in known:
            raise SettingsError(f"{where}: detections.{key} is '{one_line(value, 40)}'; {did_you_mean(value, known)}")
    for key in ("pulses", "gate_cells"):
        if getattr(d, key) < 1:
            raise SettingsError(f"{where}: detections.{key} is {getattr(d, key)}, expected 1 or more")
    for key in ("saturation", "threshold", "sphere_radius_m"):
        value = getattr(d, key)
        if value is not None and value <= 0:
            raise SettingsError(f"{where}: detections.{key} is {value:g}, expected more than 0")
    if d.false_alarm_probability is not None and not 0 < d.false_alarm_probability < 1:
        raise SettingsError(
            f"{where}: detections.false_alarm_probability is {d.false_alarm_probability:g}, expected between 0 and 1"
        )
    parts = ("energy_j", "gain_transmit_db", "gain_receive_db", "wavelength_m")
    given = [p for p in parts if getattr(e, p) is not None and p != "wavelength_m"]
    if e.loop_gain_db is not None and given:
        raise SettingsError(f"{where}: radar_equation gives loop_gain_db and {given[0]}; keep one way")
    if given and (missing := [p for p in parts if getattr(e, p) is None]):
        raise SettingsError(f"{where}: radar_equation needs {missing[0]} too, or loop_gain_db instead of the parts")
    for key in ("energy_j", "wavelength_m", "noise_temperature_k"):
        value = getattr(e, key)
        if value is not None and value <= 0:
            raise SettingsError(f"{where}: radar_equation.{key} is {value:g}, expected more than 0")


def _check_array(array: SensorArray, where: str) -> None:
    for key in ("frequency_hz", "propagation_speed_m_s", "sampling_rate_hz", "block_s"):
        value = getattr(array, key)
        if value is not None and value <= 0:
            raise SettingsError(f"{where}: array.{key} is {value:g}, expected more than 0")
    for key, known in (
        ("y_axis", ("right", "left")),
        ("bearings", ("array", "compass")),
        ("pattern", ("omnidirectional", "cosine", "baffle")),
    ):
        value = getattr(array, key)
        if value not in known:
            raise SettingsError(f"{where}: array.{key} is '{one_line(value, 40)}'; {did_you_mean(value, known)}")
    widths = {len(row) for row in array.sensor_position_m}
    if widths and widths not in ({2}, {3}):
        raise SettingsError(
            f"{where}: array.sensor_position_m has rows of {', '.join(map(str, sorted(widths)))} numbers, expected 2 "
            "(x, y) or 3 (x, y, z) in each"
        )
    if array.sensors and widths and len(array.sensors) != len(array.sensor_position_m):
        raise SettingsError(
            f"{where}: array.sensors names {len(array.sensors)}, array.sensor_position_m has "
            f"{len(array.sensor_position_m)} rows"
        )
    if array.targets is not None and array.targets < 1:
        raise SettingsError(f"{where}: array.targets is {array.targets}, expected 1 or more")
    if array.sector_deg and not (len(array.sector_deg) == 2 and array.sector_deg[0] < array.sector_deg[1]):
        raise SettingsError(f"{where}: array.sector_deg is {list(array.sector_deg)}, expected [low, high] in degrees")
    if array.targets is not None and array.start_bearing_deg and len(array.start_bearing_deg) != array.targets:
        raise SettingsError(
            f"{where}: array.start_bearing_deg gives {len(array.start_bearing_deg)} bearings for "
            f"{array.targets} targets"
        )
    if array.start_rate_deg_s and len(array.start_rate_deg_s) != len(array.start_bearing_deg):
        raise SettingsError(
            f"{where}: array.start_rate_deg_s gives {len(array.start_rate_deg_s)} rates for "
            f"{len(array.start_bearing_deg)} start_bearing_deg"
        )
    band = array.band_hz
    if band and not (len(band) == 2 and 0 <= band[0] < band[1]):
        raise SettingsError(f"{where}: array.band_hz is {list(band)}, expected [low, high] in Hz")


def _check_attitude(attitude: Attitude, where: str) -> None:
    known = [*SENSORS, *(f"{sensor}_{axis}" for sensor in SENSORS for axis in ("x", "z"))]
    for name in attitude.radius_m:
        if name not in known:
            raise SettingsError(
                f"{where}: attitude.radius_m names '{one_line(name, 40)}', which is no sensor; "
                f"{did_you_mean(name, known)}"
            )
    if attitude.single_sensor is not None and attitude.single_sensor not in SENSORS:
        raise SettingsError(
            f"{where}: attitude.single_sensor is '{one_line(attitude.single_sensor, 40)}'; "
            f"{did_you_mean(attitude.single_sensor, SENSORS)}"
        )
    if attitude.gravity_m_s2 is not None and not 9.5 < attitude.gravity_m_s2 < 10.0:
        raise SettingsError(f"{where}: attitude.gravity_m_s2 is {attitude.gravity_m_s2:g}, expected 9.5 to 10 m/s^2")
    for name in ("radius_sigma_m", "bias_sigma_m_s2", "time_skew_s", "sway_m", "gravity_sigma_m_s2"):
        if getattr(attitude, name) < 0:
            raise SettingsError(f"{where}: attitude.{name} is {getattr(attitude, name):g}, expected 0 or more")
