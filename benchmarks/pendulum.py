"""What single-sensor tilt and the multi-height method err by on a real pendulum, against its optical reference.

Reads the RepoIMU recording `Pendulum_Test02a_Trial1` (Szczesna et al. 2016): three inertial units, one on each segment
of a three-segment pendulum, each with an optical orientation. The data are not part of this repository.

    python benchmarks/pendulum.py FOLDER     # holding ..._Segment_1.csv, _2.csv, _3.csv

Radii are fitted on the first half against the first segment's reference, errors are counted on the second half.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from scipy.signal import savgol_filter

from rangeeval.physics.attitude import height_weights, radius_from_reference, tilt

G = 9.81
STEP = 0.0111  # s, that of the recording
SMOOTH = 17  # samples; the swing is at 0.66 Hz


def read(path: Path) -> np.ndarray:
    """Rows of time, quaternion, acceleration, ...; a decimal comma in one line is read as a point."""
    lines = path.read_text(encoding="utf-8-sig").splitlines()[2:]
    return np.array([[float(v.replace(",", ".")) if v else np.nan for v in line.split(";")] for line in lines])


def swing_and_force(rows: np.ndarray, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Reference angle about the swing axis (rad) and tangential reading (m/s^2), even in time, zero at rest."""
    later = np.concatenate([[True], np.diff(rows[:, 0]) > 0])
    rows = rows[later]
    w, x, y, z = rows[:, 1:5].T
    angle = np.unwrap(np.nan_to_num(np.arctan2(2 * (x * y + z * w), 1 - 2 * (y * y + z * z))))
    # The sensors' y axis points against the sense in which a reading is +g sin(alpha).
    force = -(rows[:, 6] - rows[:60, 6].mean())
    there = np.isfinite(force)
    return (
        np.interp(time, rows[:, 0], angle),
        savgol_filter(np.interp(time, rows[there, 0], force[there]), SMOOTH, 3),
    )


def main() -> None:
    """Fit on the first half, count on the second, print."""
    folder = Path(sys.argv[1])
    files = [folder / f"Pendulum_Test02a_Trial1_Segment_{i}.csv" for i in (1, 2, 3)]
    tables = [read(file) for file in files]
    time = np.arange(0, tables[0][-1, 0], STEP)
    angles, forces = (np.array(v) for v in zip(*(swing_and_force(t, time) for t in tables), strict=True))
    swing = savgol_filter(angles[0], SMOOTH, 3, deriv=2, delta=STEP)
    first = time < 87.0
    radii = [radius_from_reference(f[first], angles[0][first], swing[first], G)[0] for f in forces]
    bend = np.hypot(angles[0] - angles[1], angles[1] - angles[2])
    second = np.rad2deg(np.sqrt(np.convolve(bend**2, np.ones(90) / 90, "same")))  # over one second

    def error(found: np.ndarray, chosen: np.ndarray) -> float:
        away = (found - angles[0])[chosen]
        return float(np.rad2deg(np.sqrt(np.nanmean(away**2))))

    methods = {f"one accelerometer, segment {i + 1}": tilt(forces[i], G) for i in range(3)}
    for some in ((0, 1), (0, 2), (0, 1, 2)):
        weights = height_weights([radii[i] for i in some]).centre
        methods[f"heights {', '.join(str(i + 1) for i in some)}"] = tilt(weights @ forces[list(some)], G)
    methods["segment 1 less its own R alpha_dd"] = tilt(forces[0] - radii[0] * swing, G)
    print("effective radii (m): " + ", ".join(f"{r:.3f}" for r in radii))
    cases = {"below 2": (0, 2), "2 to 8": (2, 8), "above 8": (8, np.inf), "all": (0, np.inf)}
    picked = {name: ~first & (second >= low) & (second < high) for name, (low, high) in cases.items()}
    print(f"{'bend between segments (deg, rms of 1 s)':40s}" + "".join(f"{name:>10s}" for name in cases))
    print(f"{'samples':40s}" + "".join(f"{np.count_nonzero(m):10d}" for m in picked.values()))
    print(f"{'swing of segment 1 (rms)':40s}" + "".join(f"{error(0 * angles[0], m):10.2f}" for m in picked.values()))
    for name, found in methods.items():
        print(f"{name:40s}" + "".join(f"{error(found, m):10.2f}" for m in picked.values()))


if __name__ == "__main__":
    main()
