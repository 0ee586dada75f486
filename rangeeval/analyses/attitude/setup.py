"""What the analysis starts from: which sensors stand where, gravity, and a plain word on what is missing."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from rangeeval.errors import InputError, SettingsError
from rangeeval.model import Log, Problem, Trial
from rangeeval.model.kinds import SENSORS
from rangeeval.model.settings import Attitude
from rangeeval.physics.gravity import STANDARD_GRAVITY_M_S2, normal_gravity

AXES = ("x", "z")


@dataclass(frozen=True)
class Channel:
    """One sensor on one axis, and the log that holds it."""

    sensor: str
    axis: str
    log: int

    @property
    def column(self) -> str:
        """Its column in the log."""
        return f"{self.sensor}_{self.axis}_accel_m_s2"


@dataclass(frozen=True)
class Setup:
    """The tilt logs, their channels (axis x first), the radii that are known, gravity and how it was had."""

    logs: tuple[Log, ...]
    channels: tuple[Channel, ...]
    radii: Mapping[tuple[str, str], float]
    gravity: float
    gravity_from: str
    single: str
    settings: Attitude
    problems: tuple[Problem, ...]

    def of_axis(self, axis: str) -> list[int]:
        """The numbers of an axis's channels."""
        return [i for i, c in enumerate(self.channels) if c.axis == axis]

    def sensors(self, axis: str) -> tuple[str, ...]:
        """The names of an axis's sensors."""
        return tuple(c.sensor for c in self.channels if c.axis == axis)

    def radii_of(self, axis: str) -> list[float] | None:
        """The radii of an axis's sensors; None unless all are known."""
        known = [self.radii.get((s, axis)) for s in self.sensors(axis)]
        return None if any(r is None for r in known) else [float(r) for r in known if r is not None]

    @property
    def source(self) -> str:
        """The names of the logs."""
        return ", ".join(log.source for log in self.logs)


def set_up(trial: Trial) -> Setup:
    """Find the sensors of the trial's tilt logs.

    Raises
    ------
    InputError : no tilt log, a channel in two logs, or radii that cannot tell tilt from acceleration.
    """
    logs = trial.of_kind("tilt") or (trial.log("tilt"),)
    settings = trial.settings.attitude
    channels: list[Channel] = []
    for axis in AXES:
        for sensor in SENSORS:
            holders = [i for i, log in enumerate(logs) if f"{sensor}_{axis}_accel_m_s2" in log]
            if len(holders) > 1:
                names = " and ".join(logs[i].source for i in holders[:2])
                raise InputError(
                    f"{names} both hold {sensor}_{axis}_accel_m_s2; say in trial.toml ([[logs]] columns) which sensor "
                    f"is which, such as sensor_3_{axis}_accel_m_s2, or put each run in a folder of its own"
                )
            channels += [Channel(sensor, axis, i) for i in holders]
    if not channels:
        raise InputError(f"{logs[0].source}: no accelerometer reading of the x or z rotation in it")
    radii = {(c.sensor, c.axis): r for c in channels if (r := radius_of(settings, c.sensor, c.axis)) is not None}
    gravity, origin = _gravity(trial)
    single = settings.single_sensor or channels[0].sensor
    if single not in {c.sensor for c in channels}:
        raise SettingsError(f"attitude.single_sensor is '{single}', but no tilt log holds that sensor")
    setup = Setup(logs, tuple(channels), radii, gravity, origin, single, settings, ())
    return Setup(logs, tuple(channels), radii, gravity, origin, single, settings, tuple(_problems(setup)))


def radius_of(settings: Attitude, sensor: str, axis: str) -> float | None:
    """The radius (m) that the settings give a sensor on an axis."""
    for name in (f"{sensor}_{axis}", sensor):
        if name in settings.radius_m:
            return settings.radius_m[name]
    given: float | None = getattr(settings, f"radius_{sensor}_m", None)
    return given


def positions_of(setup: Setup, axis: str) -> list[float] | None:
    """Positions of an axis's sensors against each other (m), where radii are not known but the spacing is."""
    radii = setup.radii_of(axis)
    if radii is not None:
        return radii
    if setup.settings.spacing_m is not None and set(setup.sensors(axis)) == {"upper", "lower"}:
        return [setup.settings.spacing_m if s == "upper" else 0.0 for s in setup.sensors(axis)]
    return None


def _gravity(trial: Trial) -> tuple[float, str]:
    settings, site = trial.settings.attitude, trial.settings.site
    if settings.gravity_m_s2 is not None:
        return settings.gravity_m_s2, "as given"
    if site.latitude_deg is not None:
        return float(normal_gravity(math.radians(site.latitude_deg), site.height_m)), "from latitude and height"
    return STANDARD_GRAVITY_M_S2, "standard gravity, since the site's latitude is not given"


def _problems(setup: Setup) -> list[Problem]:
    found = []
    if setup.gravity_from.startswith("standard"):
        found.append(
            Problem(setup.source, "no site.latitude_deg and no attitude.gravity_m_s2: standard gravity is used")
        )
    for axis in AXES:
        sensors = setup.sensors(axis)
        if not sensors:
            found.append(
                Problem(setup.source, f"no reading of the {axis} rotation: nothing can be said of alpha_{axis}")
            )
            continue
        other = "z" if axis == "x" else "x"
        if len(sensors) == 1:
            lost = [s for s in setup.sensors(other) if s not in sensors]
            what = f"no column {lost[0]}_{axis}_accel_m_s2: " if lost else ""
            found.append(Problem(
                setup.source,
                f"{what}only one accelerometer reads the {axis} rotation, so angular acceleration is taken for tilt",
            ))  # fmt: skip
            continue
        radii = setup.radii_of(axis)
        if radii is None:
            known = setup.settings.spacing_m is not None
            missing = [s for s in sensors if (s, axis) not in setup.radii]
            found.append(Problem(
                setup.source,
                f"the radii of {' and '.join(missing)} are not in trial.toml [attitude]"
                + (": found from the oscillation and spacing_m" if known else
                   "; give radius_upper_m and radius_lower_m (or spacing_m, from which an oscillation can show them)"),
            ))  # fmt: skip
        elif max(radii) == min(radii):
            names = " and ".join(sensors)
            raise InputError(
                f"trial.toml: the radii of {names} ({axis} rotation) are all {radii[0]:g} m; tilt and angular "
                f"acceleration can be told apart only by sensors at different radii"
            )
    return found
