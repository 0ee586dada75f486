"""Crowds of small trials, and an installed package whose analysis crashes on some of them."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

DIES = "dies"  # a trial whose name begins so kills the process that evaluates it
KILLS = "kills"  # ... kills the worker above that process too
HANGS = "hangs"  # ... never ends

_PACKAGE = '''
"""An analysis with a fault in its native code, as it were."""
import os
import signal
import time

from rangeeval.analyses import Analysis
from rangeeval.model import Result


def faulty(trial, bins=None, *, confidence=0.95, progress=None):
    if trial.title.startswith("kills"):
        os.kill(os.getppid(), signal.SIGKILL)
    if trial.title.startswith(("kills", "dies")):
        os.kill(os.getpid(), signal.SIGKILL)
    if trial.title.startswith("hangs"):
        time.sleep(1000)
    return Result("faulty", (), settings={"confidence": confidence})


FAULTY = Analysis("rangeeval_faulty:faulty", needs=("residuals",))
'''


def small_trial(
    folder: Path, seed: int, *, name: str = "", date: str = "", software: str = "", sigma: float = 3.0, rows: int = 60
) -> Path:
    """A folder with a short residual log in one range bin, and what its trial.toml says."""
    folder.mkdir(parents=True)
    rng = np.random.default_rng(seed)
    lines = ["time_s,range_residual_m,range_predicted_m,alpha,beta"]
    lines += [f"{0.5 * i},{e:.4f},{79_000 - 20 * i},0.4,0.1" for i, e in enumerate(rng.normal(0, sigma, rows))]
    (folder / "residuals.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    words = {"name": name or folder.name, "date": date, "software": software, "radar": "MFR-1"}
    toml = "".join(f'{key} = "{value}"\n' for key, value in words.items())
    (folder / "trial.toml").write_text(f"[trial]\n{toml}", encoding="utf-8")
    return folder


def faulty_package(folder: Path) -> dict[str, str]:
    """Put a package with a faulty analysis into a folder; returns the environment in which it is installed."""
    about = folder / "rangeeval_faulty-1.dist-info"
    about.mkdir(parents=True)
    (folder / "rangeeval_faulty.py").write_text(_PACKAGE, encoding="utf-8")
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: rangeeval-faulty\nVersion: 1\n", encoding="utf-8")
    (about / "entry_points.txt").write_text(
        "[rangeeval.analyses]\nfaulty = rangeeval_faulty:FAULTY\n", encoding="utf-8"
    )
    root = Path(__file__).parents[1]
    path = os.pathsep.join([str(folder), str(root), os.environ.get("PYTHONPATH", "")]).strip(os.pathsep)
    return {**os.environ, "PYTHONPATH": path}
