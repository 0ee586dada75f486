"""The legacy sample: one simulated flight, written as an old recorder would have written it.

`python -m tests.legacy FOLDER` writes it again.
"""

from __future__ import annotations

import csv
import sys
import tempfile
from pathlib import Path

from rangeeval.scenarios import simulate_alpha_beta

FOOT = 0.3048

TRIAL_TOML = """\
# An old recorder's log: a preamble, semicolons, decimal commas, feet, its own column names.
[trial]
name = "Inbound pass, legacy recorder"
date = 2026-05-14
radar = "Simulated phased array"
handling = "UNCLASSIFIED - SIMULATED DATA"

[[logs]]
file = "ES_0514.txt"
kind = "residuals"
delimiter = ";"
decimal = ","
skip_rows = 5
encoding = "cp1252"

[logs.columns]
"T(s)" = "time_s"
"TRK" = "track_id"
"ES_R(ft)" = "range_residual_ft"
"ES_Y(ft)" = "y_residual_ft"
"ES_Z(ft)" = "z_residual_ft"
"R_PRE(km)" = "range_predicted_km"
"Y_PRE(km)" = "y_predicted_km"
"Z_PRE(km)" = "z_predicted_km"
"S/N(dB)" = "snr_db"
"A_R" = "alpha_range"
"B_R" = "beta_range"
"A_Y" = "alpha_y"
"B_Y" = "beta_y"
"A_Z" = "alpha_z"
"B_Z" = "beta_z"
"OP" = ""
"""

PREAMBLE = """\
RANGE RECORDER V2.1
Messgerät: Prüfstand 3
Datum: 14.05.2026
Ziel: T001

"""

HEADER = "T(s);TRK;ES_R(ft);ES_Y(ft);ES_Z(ft);R_PRE(km);Y_PRE(km);Z_PRE(km);S/N(dB);A_R;B_R;A_Y;B_Y;A_Z;B_Z;OP"


def _line(update: dict[str, str], gains: dict[str, str]) -> str:
    fields = [f"{float(update['time_s']):.3f}", "1"]
    fields += [f"{float(update[f'{axis}_residual_m']) / FOOT:.4f}" for axis in ("range", "y", "z")]
    fields += [f"{float(update[f'{axis}_predicted_m']) / 1000:.6f}" for axis in ("range", "y", "z")]
    fields += [f"{float(update['snr_db']):.2f}"]
    fields += [f"{float(gains[f'{gain}_{axis}']):.6f}" for axis in ("range", "y", "z") for gain in ("alpha", "beta")]
    return ";".join(fields).replace(".", ",") + ";KIM"


def write(folder: Path) -> None:
    """Write `trial.toml` and `ES_0514.txt`."""
    with tempfile.TemporaryDirectory() as scratch:
        simulate_alpha_beta(scratch, seed=1, flights=1, no_truth=True)
        with (Path(scratch) / "residuals.csv").open() as one, (Path(scratch) / "gains.csv").open() as other:
            lines = [_line(*both) for both in zip(csv.DictReader(one), csv.DictReader(other), strict=True)]
    lines[99] = lines[99].replace(lines[99].split(";")[2], "N/A")  # a missing value
    lines[199] = lines[199].replace(lines[199].split(";")[3], "****")  # an overflow of the recorder's field
    lines.insert(300, lines[299])  # the same update twice
    folder.mkdir(parents=True, exist_ok=True)
    text = PREAMBLE + HEADER + "\n" + "\n".join(lines) + "\n"
    (folder / "ES_0514.txt").write_bytes(text.replace("\n", "\r\n").encode("cp1252"))
    (folder / "trial.toml").write_text(TRIAL_TOML, encoding="utf-8")


if __name__ == "__main__":
    write(Path(sys.argv[1]))
