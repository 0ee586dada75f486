"""Columns of numbers written as a log that a person can read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray


def column(values: NDArray[np.float64], decimals: int) -> list[str]:
    """Numbers as text, empty where missing (a coasted update has no residual)."""
    return ["" if v != v else f"{v:.{decimals}f}" for v in values.tolist()]


def write_csv(path: Path, columns: dict[str, list[str]]) -> Path:
    """Write columns of text as a CSV file, and return its path."""
    rows = zip(*columns.values(), strict=True)
    path.write_text("\n".join([",".join(columns), *(",".join(row) for row in rows)]) + "\n", encoding="utf-8")
    return path
