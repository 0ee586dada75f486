"""Microseconds per update of the two-model IMM filter, against filterpy and, where installed, Stone Soup's components.

One run on one core, all on the same plots of the source paper's flight: batched over 200 runs, one run per call, with every
output, with all that smoothing needs; then the tuning of one 100-point track with 1000 evaluations of its likelihood, and the
seconds that the first use costs (compilation in an empty cache, in a process of its own).

    python benchmarks/imm.py
    python benchmarks/imm.py --no-compile
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable

import numpy as np

from rangeeval.scenarios.imm import SIGMA, flight, measured
from rangeeval.tracking import polar
from rangeeval.tracking.cycle import DETAIL, LIKELIHOOD, UPDATES
from rangeeval.tracking.filters import PAPER_IMM
from rangeeval.tracking.measurements import Measurements, wrapped
from rangeeval.tracking.motion import noise_matrix, transition
from rangeeval.tracking.runs import Batch, log_likelihood, run, run_table
from rangeeval.tracking.starting import three_point
from rangeeval.tracking.tuning import Likelihood, parameters_of, tune

FIRST_USE = """
import time
from rangeeval.scenarios.imm import SIGMA, flight, measured
from rangeeval.tracking.filters import PAPER_IMM
from rangeeval.tracking.measurements import Measurements
from rangeeval.tracking.runs import run
started = time.perf_counter(), time.process_time()
truth = flight()
run(PAPER_IMM, Measurements.of(truth.time_s, measured(truth, 1), SIGMA))
print(time.perf_counter() - started[0], time.process_time() - started[1])
"""


def best(job: Callable[[], object], repeats: int) -> float:
    """Least seconds of several repeats: what the code costs when nothing else runs."""
    seconds = []
    for _ in range(repeats):
        started = time.perf_counter()
        job()
        seconds.append(time.perf_counter() - started)
    return min(seconds)


def densities(track: Measurements) -> tuple[np.ndarray, np.ndarray]:
    """The start with nine states and an unknown turn rate."""
    x, p = three_point(track.time_s[:3], track.z[:3], SIGMA)
    x[6:], p[6:], p[:, 6:] = 0.0, 0.0, 0.0
    p[6:, 6:] = np.eye(3) * PAPER_IMM.models[1].prior_turn_rad_s ** 2
    return x, p


def moved(motion: str, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Prediction and Jacobian of nine states; straight flight leaves the turn rate alone."""
    y, f = transition(motion, x, 1.0)
    if motion == "cv":
        f = f.copy()
        f[6:, 6:] = np.eye(3)
        y = f @ x
    return y, f


def filterpy_states(track: Measurements) -> np.ndarray:
    """filterpy's IMMEstimator over two of its extended Kalman filters, nine states each."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from filterpy.kalman import ExtendedKalmanFilter, IMMEstimator

    def residual(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        d = a - b
        d[1] = wrapped(d[1])
        return d

    class One(ExtendedKalmanFilter):
        def __init__(self, model):
            super().__init__(dim_x=9, dim_z=3)
            self.model, self.R = model, np.diag(SIGMA**2)
            self.x, self.P = densities(track)
            self.noise = noise_matrix(model.motion, model.sigma_m_s2, model.sigma_turn_rad_s, 1.0)

        def predict(self, u=None):
            self.x, f = moved(self.model.motion, self.x)
            self.P = f @ self.P @ f.T + self.noise

        def update(self, z):
            super().update(
                z,
                lambda x: np.hstack([polar.jacobian(x[:3]), np.zeros((3, 6))]),
                lambda x: polar.of_position(x[:3]),
                residual=residual,
            )
            if self.model.motion == "cv":
                self.x[6:], self.P[6:], self.P[:, 6:] = 0.0, 0.0, 0.0
                self.P[6:, 6:] = np.eye(3) * PAPER_IMM.models[1].prior_turn_rad_s ** 2

    imm = IMMEstimator([One(model) for model in PAPER_IMM.models], [0.5, 0.5], np.array(PAPER_IMM.transition))
    states = []
    for z in track.z[3:]:
        imm.predict()
        imm.update(z)
        states.append(imm.x[:6].copy())
    return np.array(states)


def stone_soup_states(track: Measurements) -> np.ndarray | None:
    """An IMM of Stone Soup's extended Kalman predictors and updaters (it has none of its own); None if not installed."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            from stonesoup.models.measurement.nonlinear import CartesianToElevationBearingRange
            from stonesoup.models.transition.base import TransitionModel
            from stonesoup.predictor.kalman import ExtendedKalmanPredictor
            from stonesoup.types.array import CovarianceMatrix, StateVector
            from stonesoup.types.detection import Detection
            from stonesoup.types.hypothesis import SingleHypothesis
            from stonesoup.types.state import GaussianState
            from stonesoup.updater.kalman import ExtendedKalmanUpdater
        except ImportError:
            return None
        from datetime import datetime, timedelta

        from stonesoup.base import Property

        class Motion(TransitionModel):
            """One of our motion models under Stone Soup's interface."""

            model: object = Property(doc="motion model")

            @property
            def ndim_state(self):
                return 9

            def function(self, state, noise=False, **kwargs):
                return StateVector(moved(self.model.motion, np.asarray(state.state_vector, dtype=float).ravel())[0])

            def jacobian(self, state, **kwargs):
                return moved(self.model.motion, np.asarray(state.state_vector, dtype=float).ravel())[1]

            def covar(self, **kwargs):
                m = self.model
                return CovarianceMatrix(noise_matrix(m.motion, m.sigma_m_s2, m.sigma_turn_rad_s, 1.0))

            def rvs(self, *args, **kwargs):
                raise NotImplementedError

            def pdf(self, *args, **kwargs):
                raise NotImplementedError

        sensor = CartesianToElevationBearingRange(
            ndim_state=9, mapping=(0, 1, 2), noise_covar=CovarianceMatrix(np.diag(SIGMA[[2, 1, 0]] ** 2))
        )
        predictors = [ExtendedKalmanPredictor(Motion(model=model)) for model in PAPER_IMM.models]
        updater = ExtendedKalmanUpdater(sensor)
        pi, mu = np.array(PAPER_IMM.transition), np.array([0.5, 0.5])
        x, p = densities(track)
        xs, ps = [x.copy(), x.copy()], [p.copy(), p.copy()]
        now, states = datetime(2026, 1, 1), []
        for z in track.z[3:]:
            now += timedelta(seconds=1)
            cbar = mu @ pi
            weights = pi * mu[:, None] / cbar
            likelihood, updated = np.empty(2), []
            for j in range(2):
                mean = sum(weights[i, j] * xs[i] for i in range(2))
                spread = sum(weights[i, j] * (ps[i] + np.outer(xs[i] - mean, xs[i] - mean)) for i in range(2))
                prior = GaussianState(StateVector(mean), CovarianceMatrix(spread), now - timedelta(seconds=1))
                prediction = predictors[j].predict(prior, timestamp=now)
                plot = Detection(StateVector([z[2], z[1], z[0]]), timestamp=now, measurement_model=sensor)
                expected = updater.predict_measurement(prediction)
                hypothesis = SingleHypothesis(prediction, plot, expected)
                posterior = updater.update(hypothesis)
                nu = np.asarray(plot.state_vector - expected.state_vector, dtype=float).ravel()
                s = np.asarray(expected.covar, dtype=float)
                likelihood[j] = -0.5 * (nu @ np.linalg.solve(s, nu) + np.linalg.slogdet(2 * np.pi * s)[1])
                updated.append(posterior)
            mu = cbar * np.exp(likelihood - likelihood.max())
            mu /= mu.sum()
            xs = [np.asarray(u.state_vector, dtype=float).ravel() for u in updated]
            ps = [np.array(u.covar, dtype=float) for u in updated]
            states.append(sum(m * x[:6] for m, x in zip(mu, xs, strict=True)))
            xs[0][6:], ps[0][6:], ps[0][:, 6:] = 0.0, 0.0, 0.0
            ps[0][6:, 6:] = np.eye(3) * PAPER_IMM.models[1].prior_turn_rad_s ** 2
    return np.array(states)


def main() -> None:
    """Measure and print."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--no-compile", action="store_true", help="leave out the seconds of the first use")
    given = options.parse_args()
    truth = flight()
    tracks = [Measurements.of(truth.time_s, measured(truth, 20240, r), SIGMA) for r in range(200)]
    one, many = Batch.of(tracks[:1]), Batch.of(tracks)
    updates = len(truth.time_s) - 3
    states = run(PAPER_IMM, tracks[0]).state[3:]
    log_likelihood(PAPER_IMM, one)

    rows: list[tuple[str, float, str]] = []
    for name, level in (("likelihood only", LIKELIHOOD), ("all outputs", UPDATES), ("and for smoothing", DETAIL)):
        seconds = best(lambda: run_table(PAPER_IMM, many, level), 20)
        rows.append((f"batched over 200 runs, {name}", seconds / (200 * updates) * 1e6, ""))
    likelihood = Likelihood(PAPER_IMM, parameters_of(PAPER_IMM), one)
    rows.append(
        ("one run per call, likelihood only", best(lambda: likelihood(likelihood.values), 500) / updates * 1e6, "")
    )
    rows.append(("one run per call, all outputs", best(lambda: run(PAPER_IMM, tracks[0]), 200) / updates * 1e6, ""))
    for name, job in (("filterpy", filterpy_states), ("Stone Soup components", stone_soup_states)):
        theirs = job(tracks[0])
        if theirs is None:
            print(f"{name}: not installed, left out")
            continue
        apart = f"  positions {np.max(np.abs(theirs[:, :3] - states[:, :3])):.0e} m apart"
        rows.append((name, best(lambda job=job: job(tracks[0]), 5) / updates * 1e6, apart))
    least = rows[0][1]
    print(f"{'two-model IMM, 3-D polar plots':44s}{'us/update':>10s}{'ratio':>9s}")
    for name, micro, note in rows:
        print(f"{name:44s}{micro:10.2f}{micro / least:9.1f}{note}")

    values = likelihood.values
    seconds = best(lambda: [likelihood(values) for _ in range(1000)], 5)
    print(f"1000 evaluations of the likelihood of one 100-point track: {seconds:.3f} s")
    found = tune(PAPER_IMM, tracks[:1], intervals=False, evaluations=1000)
    seconds = best(lambda: tune(PAPER_IMM, tracks[:1], intervals=False, evaluations=1000), 3)
    each = seconds / found.evaluations * 1000
    print(f"tuning of its six parameters: {found.evaluations} evaluations in {seconds:.3f} s, {each:.3f} s per 1000")
    if not given.no_compile:
        with tempfile.TemporaryDirectory() as cache:
            environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
            for name in ("first use, empty cache", "first use, cached"):
                out = subprocess.run(
                    [sys.executable, "-c", FIRST_USE], env=environment, capture_output=True, check=True
                )
                wall, cpu = map(float, out.stdout.split())
                print(f"{name}: {wall:.2f} s, {cpu:.2f} s of processor")


if __name__ == "__main__":
    main()
