"""Questions asked of a bin of residuals: is the mean zero, are they normal, does sigma drift, are there
outliers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

#: 1 / (0.75 quantile of the standard normal): makes the median absolute deviation a sigma.
MAD_TO_SIGMA = 1.482602218505602


@dataclass(frozen=True)
class TestResult:
    """A test statistic with its degrees of freedom and p value; NaN where the test cannot be made."""

    __test__ = False  # pytest: not a test class

    statistic: float
    dof: float
    p_value: float


_NO_TEST = TestResult(float("nan"), float("nan"), float("nan"))


def mean_t_test(n: float, mean: float, s: float, vif: float = 1.0, dof: float | None = None) -> TestResult:
    """Test whether a mean differs from zero, counting the memory of the samples through `vif`.

    `vif` is the variance of the mean over that of independent samples. Without it (1) the test never rejects
    for a target at constant velocity and rejects in 40 % of sound cases when the target manoeuvres three
    times the design.

    References
    ----------
    Student's t with min(n, n / vif) - 1 degrees of freedom, unless `dof` says how well `vif` is known.
    """
    if dof is None:
        dof = min(n, n / vif) - 1 if vif > 0 else n - 1
    if not (n >= 2 and s > 0 and vif > 0 and dof > 0):
        return _NO_TEST
    t = mean / (s * np.sqrt(vif / n))
    return TestResult(float(t), float(dof), float(2 * special.stdtr(dof, -abs(t))))


@dataclass(frozen=True)
class Normality:
    """Skewness, kurtosis (3 for normal), test statistic and p value of a test of normality."""

    skewness: float
    kurtosis: float
    statistic: float
    p_value: float


def jarque_bera(values: ArrayLike) -> Normality:
    """Test whether values (n) are normal by their skewness and kurtosis; slow to converge below 100 values.

    References
    ----------
    Jarque and Bera (1980).
    """
    x = _finite(values)
    d = x - x.mean() if x.size else x
    return jarque_bera_from_moments(x.size, float(np.sum(d**2)), float(np.sum(d**3)), float(np.sum(d**4)))


def jarque_bera_from_moments(n: float, m2: float, m3: float, m4: float) -> Normality:
    """Give the same as `jarque_bera` from sums of powers of the deviations from the mean; NaN when all are
    equal.
    """
    if not (n >= 2 and m2 > 0):
        return Normality(float("nan"), float("nan"), float("nan"), float("nan"))
    skewness = np.sqrt(n) * m3 / m2**1.5
    kurtosis = n * m4 / m2**2
    statistic = n / 6 * (skewness**2 + (kurtosis - 3) ** 2 / 4)
    return Normality(float(skewness), float(kurtosis), float(statistic), float(np.exp(-statistic / 2)))


def shapiro_wilk(values: ArrayLike) -> TestResult:
    """Test whether 3 to 5000 values are normal, the better test below 100 values; NaN for other numbers.

    References
    ----------
    Shapiro and Wilk (1965); Royston (1995), AS R94.
    """
    x = _finite(values)
    if not 3 <= x.size <= 5000 or np.ptp(x) == 0:
        return _NO_TEST
    from scipy import stats  # slow to import, and needed only here

    w, p = stats.shapiro(x)
    return TestResult(float(w), float(x.size), float(p))


def spearman(x: ArrayLike, y: ArrayLike) -> TestResult:
    """Rank correlation of two lists (n each) and its p value; NaN below three pairs or when one list is
    constant.

    Applied to |residual| and range or SNR it shows a sigma that drifts inside a bin.

    References
    ----------
    Spearman (1904); p from t = r sqrt((n-2)/(1-r^2)), n - 2 degrees of freedom.
    """
    a, b = np.asarray(x, dtype=np.float64).ravel(), np.asarray(y, dtype=np.float64).ravel()
    both = np.isfinite(a) & np.isfinite(b)
    n = int(np.count_nonzero(both))
    if n < 3:
        return _NO_TEST
    ra, rb = ranks(a[both]), ranks(b[both])
    da, db = ra - ra.mean(), rb - rb.mean()
    size = float(np.sqrt((da @ da) * (db @ db)))
    if size == 0:
        return _NO_TEST
    r = float(np.clip(da @ db / size, -1.0, 1.0))
    if abs(r) == 1.0:
        return TestResult(r, n - 2.0, 0.0)
    t = abs(r) * np.sqrt((n - 2) / ((1 - r) * (1 + r)))
    return TestResult(r, n - 2.0, float(2 * special.stdtr(n - 2, -t)))


def ranks(values: ArrayLike) -> FloatArray:
    """Give the rank of each value from 1; equal values share their mean rank."""
    inverse, counts = np.unique(np.asarray(values, dtype=np.float64), return_inverse=True, return_counts=True)[1:]
    last = np.cumsum(counts)
    shared: FloatArray = (last - (counts - 1) / 2.0)[inverse]
    return shared


def mad_sigma(values: ArrayLike) -> float:
    """Sigma from the median distance to the median: hardly moved by outliers. NaN without finite values.

    References
    ----------
    Hampel (1974); Rousseeuw and Croux (1993).
    """
    x = _finite(values)
    if x.size == 0:
        return float("nan")
    return float(MAD_TO_SIGMA * np.median(np.abs(x - np.median(x))))


def outlier_mask(values: ArrayLike, k: float = 4.0) -> BoolArray:
    """Tell which values lie more than `k` robust sigmas from the median; missing values are no outliers.

    At the default 4 a normal sample loses 6 in 100 000.
    """
    x = np.asarray(values, dtype=np.float64)
    there = _finite(x)
    if there.size == 0:
        return np.zeros(x.shape, dtype=bool)
    with np.errstate(invalid="ignore"):
        far: BoolArray = np.abs(x - np.median(there)) > k * mad_sigma(there)
    return far


def gate_truncation_factor(k: ArrayLike) -> FloatArray:
    """Variance of normal residuals that an association gate at +-k sigma lets through, over their true
    variance.

    0.774 at 2, 0.973 at 3, 0.999 at 4: divide an assessed variance by it when the gate is known.
    """
    g = np.asarray(k, dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        density = np.exp(-(g**2) / 2) / np.sqrt(2 * np.pi)
        factor: FloatArray = np.where(g > 0, 1 - 2 * g * density / special.erf(g / np.sqrt(2)), np.nan)[()]
    return factor


def _finite(values: ArrayLike) -> FloatArray:
    x = np.asarray(values, dtype=np.float64).ravel()
    return x[np.isfinite(x)]
