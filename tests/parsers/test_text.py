"""Delimited text: every dialect gives the same table, every fault one clear line."""

from __future__ import annotations

import codecs
import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rangeeval.errors import InputError, RangeevalError, SettingsError
from rangeeval.model import Problem, TrialSettings, settings_from
from rangeeval.parsers import open_trial
from tests.parsers.samples import COLUMNS, compressed, csv_text, read, same, text_log

HEADER = "time_s,track_id,range_residual_m,range_predicted_m\n"
ROWS = "1,A,0.5,30000\n2,A,-0.5,31000\n"


def dialect(file: str = "residuals.csv", **keys: Any) -> TrialSettings:
    return settings_from({"logs": [{"file": file, **keys}]})


@pytest.mark.parametrize("delimiter", [",", ";", "\t", "|", " ", "   "])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_delimiters_and_line_ends(delimiter: str, end: str, tmp_path: Path) -> None:
    """Comma, semicolon, tab, bar or blanks; LF, CRLF or CR."""
    text = csv_text(delimiter=delimiter, end=end)
    if not delimiter.strip(" "):
        text = text.replace(f"{delimiter}{delimiter}", f"{delimiter}NaN{delimiter}")
    same(read(text_log(tmp_path, text)))


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le-bom", "utf-16-be-bom"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("how", ["", "gz", "zst"])
def test_encodings_and_compression(encoding: str, end: str, how: str, tmp_path: Path) -> None:
    """A byte order mark says which Unicode it is; gz and zst are looked through."""
    text = csv_text(end=end).replace("A1", "표적")
    marks = {"utf-16-le-bom": codecs.BOM_UTF16_LE, "utf-16-be-bom": codecs.BOM_UTF16_BE}
    data = marks.get(encoding, b"") + text.encode(encoding.removesuffix("-bom"))
    table = read(text_log(tmp_path, compressed(data, how) if how else data))
    assert table.texts("track_id") == ["표적", "B2"] * 3
    np.testing.assert_array_equal(table.floats("range_residual_m"), COLUMNS["range_residual_m"])


def test_another_encoding_only_when_said(tmp_path: Path) -> None:
    """CP949 is read when trial.toml says so, and otherwise refused with the line."""
    path = text_log(tmp_path, (HEADER + ROWS + "3,표적,1,30000\n").encode("cp949"))
    with pytest.raises(InputError, match=r"residuals.csv:4: byte 0x.. is not UTF-8 text; say which encoding"):
        read(path)
    table = read(path, settings=dialect(encoding="cp949"))
    assert table.texts("track_id")[2] == "표적"
    with pytest.raises(SettingsError, match=r"encoding 'no-such' in trial.toml is not known"):
        read(path, settings=dialect(encoding="no-such"))


def test_units_are_those_of_the_names(tmp_path: Path) -> None:
    """Columns in other units are converted once, whatever their case and blanks around them."""
    text = " Time_MS , range_residual_ft,Range_Predicted_km,snr_linear\n1500,1,30,100\n"
    table = read(text_log(tmp_path, text))
    assert table.floats("time_s").tolist() == [1.5]
    assert table.floats("range_residual_m").tolist() == [0.3048]
    assert table.floats("range_predicted_m").tolist() == [30000.0]
    assert table.floats("snr_db").tolist() == [20.0]


def test_a_ratio_without_decibels_is_missing_and_said(tmp_path: Path) -> None:
    """SNR 0 has no decibels: missing, flagged, and the row stays."""
    table = read(text_log(tmp_path, "time_s,range_residual_m,range_predicted_m,snr_linear\n1,1,30000,0\n"))
    assert np.isnan(table.floats("snr_db")).all()
    assert [(p.count, p.rejected) for p in table.problems] == [(1, False)]


def test_comments_before_the_header(tmp_path: Path) -> None:
    """Lines that begin with # before the header are no rows; numpy's own header comment is the header."""
    table = read(text_log(tmp_path, "# radar 1\n#\n\n" + HEADER + ROWS))
    assert (len(table), table.first_row) == (2, 5)
    buffer = io.StringIO()
    np.savetxt(buffer, [[1, 2, 3e4]], delimiter=",", header="time_s,range_residual_m,range_predicted_m")
    assert len(read(text_log(tmp_path, buffer.getvalue()))) == 1


@pytest.mark.parametrize("missing", ["", "NaN", "nan", "N/A", "-", " N/A ", " "])
def test_missing_values(missing: str, tmp_path: Path) -> None:
    """The contract's missing values are NaN, in text columns no label."""
    table = read(text_log(tmp_path, HEADER + f"1,{missing},{missing},30000\n2,A,1,30000\n"))
    assert np.isnan(table.floats("range_residual_m")).tolist() == [True, False]
    assert table.codes("track_id").tolist() == [-1, 0]
    assert table.problems == ()


def test_decimal_comma(tmp_path: Path) -> None:
    """A decimal comma is seen where the delimiter is another, or said in trial.toml."""
    columns = dict(COLUMNS)
    same(read(text_log(tmp_path, csv_text(columns, ";", ","))))
    same(read(text_log(tmp_path, csv_text(columns, ";", ",")), settings=dialect(decimal=",", delimiter=";")))


@pytest.mark.parametrize(
    ("cells", "says"),
    [
        (["1,234", "2,345"], r"residuals.csv:2: .* is '1,234', and it may be a decimal comma or digits in groups"),
        (["1.234,5", "2"], r"residuals.csv:2: .* is '1.234,5': digits in groups are not read"),
        (["1,5", "2.5"], r"residuals.csv:2: .* is '1,5', and others have a decimal point"),
    ],
)
def test_a_doubtful_decimal_sign_is_refused_with_its_line(cells: list[str], says: str, tmp_path: Path) -> None:
    """A number that can be read in two ways is never guessed."""
    rows = "".join(f"{i};A;{cell};30000\n" for i, cell in enumerate(cells))
    with pytest.raises(InputError, match=says):
        read(text_log(tmp_path, HEADER.replace(",", ";") + rows))


def test_rows_that_end_in_a_delimiter(tmp_path: Path) -> None:
    """One more field on every row is taken only when it is empty; else nothing is shifted."""
    table = read(text_log(tmp_path, HEADER + "1,A,0.5,30000,\n2,A,0.5,30000,\n3,A,0.5,30000\n"))
    assert table.floats("time_s").tolist() == [1.0, 2.0]
    assert table.floats("range_predicted_m").tolist() == [30000.0, 30000.0]
    assert rejected(table.problems) == {
        "rows with too few or too many fields": (
            1,
            "residuals.csv:4: the row has 4 fields, expected 4 and a delimiter at the end",
        )
    }
    late = HEADER + "1,A,0.5,30000,\n" * 200 + "3,A,0.5,30000,7\n"
    with pytest.raises(InputError, match=r"residuals.csv:202: the row has 5 fields, the header names 4 columns"):
        read(text_log(tmp_path, late))
    with pytest.raises(InputError, match=r"residuals.csv:2: the row has 5 fields, the header names 4 columns"):
        read(text_log(tmp_path, HEADER + "0,1,A,0.5,30000\n1,2,A,0.5,31000\n"))


def rejected(problems: tuple[Problem, ...]) -> dict[str, tuple[int, str]]:
    assert all(p.rejected for p in problems)
    return {p.reason: (p.count, p.examples[0]) for p in problems}


@pytest.mark.parametrize(
    ("row", "reason", "example"),
    [
        ("3,A,oops,1", "rows with text in a number column", "range_residual_m is 'oops', not a number"),
        ("3,A,1_0,1", "rows with text in a number column", "range_residual_m is '1_0', not a number"),
        ("3,A,0x1F,1", "rows with text in a number column", "range_residual_m is '0x1F', not a number"),
        ("3,A,\x1b[2J,1", "rows with text in a number column", r"range_residual_m is '\x1b[2J', not a number"),
        ("3,A,inf,1", "rows with an infinite number", "range_residual_m is infinite"),
        ("3,A,1e400,1", "rows with an infinite number", "range_residual_m is infinite"),
        ("3,A,1", "rows with too few or too many fields", "the row has 3 fields, expected 4"),
        ("3,A,1,1,", "rows with too few or too many fields", "the row has 5 fields, expected 4"),
        ("3,A,1,1,9,9", "rows with too few or too many fields", "the row has 6 fields, expected 4"),
        ("3,A\0,1,1", "rows with a NUL byte", "holds a NUL byte"),
        (
            '3,"A,1,1',
            "rows with a quotation mark that is not closed or stands inside a field",
            "a quotation mark is not closed or stands inside a field",
        ),
        (
            '3,A"B"C,1,1',
            "rows with a quotation mark that is not closed or stands inside a field",
            "a quotation mark is not closed or stands inside a field",
        ),
    ],
)
@pytest.mark.parametrize("blanks", [0, 2])
def test_a_bad_row_is_left_out_and_named(row: str, reason: str, example: str, blanks: int, tmp_path: Path) -> None:
    """One bad row among good ones: file, line, column and what was found; the others are as they were."""
    text = "# comment\n" + HEADER + ROWS + "\n" * blanks + row + "\n4,B,1,30000\n"
    table = read(text_log(tmp_path, text))
    assert table.floats("time_s").tolist() == [1.0, 2.0, 4.0]
    assert table.texts("track_id") == ["A", "A", "B"]
    assert rejected(table.problems) == {reason: (1, f"residuals.csv:{5 + blanks}: {example}")}


def test_quoted_fields(tmp_path: Path) -> None:
    """Quoted fields may hold the delimiter and doubled quotation marks."""
    table = read(text_log(tmp_path, HEADER + '1,"A,1","0.5",30000\n2,"B ""2""",1,30000\n3,"",1,30000\n'))
    assert table.texts("track_id") == ["A,1", 'B "2"', ""]
    assert table.floats("range_residual_m").tolist() == [0.5, 1.0, 1.0]
    assert table.problems == ()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "residuals.csv: not recognised as a log: the file is empty"),
        ("\n\n", "residuals.csv: not recognised as a log: it is empty"),
        ("1,2,3\n4,5,6\n", "residuals.csv: not recognised as a log: its header names no column of a known kind"),
        (
            "time_s,range_residual_m\n1,2\n",
            "residuals.csv: a residuals log needs the column range_predicted_m; the file has time_s, range_residual_m",
        ),
        (
            "time_s,range_residual_furlong,range_predicted_m\n1,2,3\n",
            "the unit of column 'range_residual_furlong' is not known; range_residual_m may end in _cm, _ft, _kft",
        ),
        ("time_s,range_residual,range_predicted_m\n1,2,3\n", "the unit of column 'range_residual' is not known"),
        ("time_s,range_residual_m,time_s,range_predicted_m\n", r"header names 'time_s' twice (columns 1 and 3)"),
        ("time_s,time_ms,range_residual_m,range_predicted_m\n", "both 'time_s' and 'time_ms' give time_s; keep one"),
        (HEADER + "1,5,A,0,5,30000,0\n", "residuals.csv:2: the row has 7 fields, the header names 4 columns"),
    ],
)
def test_a_file_that_cannot_be_used_is_one_clear_line(text: str, says: str, tmp_path: Path) -> None:
    """The issue's list of bad files: each gives one line that names the file and what to do."""
    with pytest.raises(RangeevalError) as caught:
        read(text_log(tmp_path, text))
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_header_alone_is_a_log_without_rows(tmp_path: Path) -> None:
    """No row: an empty table with all columns."""
    table = read(text_log(tmp_path, HEADER))
    assert len(table) == 0
    assert set(table.columns) == {"time_s", "track_id", "range_residual_m", "range_predicted_m"}


def test_a_giant_line_stops_the_reading(tmp_path: Path) -> None:
    """A line longer than 1 MB is refused with its number, in the middle and at the end."""
    for tail in ("\n" + ROWS, ""):
        path = text_log(tmp_path, HEADER + ROWS + "3," + "A" * 2_000_000 + ",1,1" + tail)
        with pytest.raises(InputError, match=r"residuals.csv:4: this line is longer than 1 MB"):
            read(path)


@pytest.mark.parametrize("how", ["gz", "zst"])
def test_a_damaged_compressed_log_is_refused(how: str, tmp_path: Path) -> None:
    """Cut-off or altered compressed data is an error, never half a log."""
    data = compressed((HEADER + ROWS * 5000).encode(), how)
    for bad in (data[:-9], data[:40] + bytes([data[40] ^ 255]) + data[41:]):
        with pytest.raises(RangeevalError, match=r"residuals.csv: "):
            read(text_log(tmp_path, bad))


def test_unknown_columns_are_named_with_the_nearest(tmp_path: Path) -> None:
    """A column that is not of the kind is not read, and a slip of the pen is pointed at."""
    trial = open_trial(
        text_log(tmp_path, "time_s,range_residual_m,range_predicted_m,wavefrom,operator\n1,1,30000,a,b\n")
    )
    assert [p.reason for p in trial.problems] == [
        "column 'wavefrom' is not one of a residuals log and is not read; did you mean 'waveform'?",
        "column 'operator' is not one of a residuals log and is not read",
    ]


def test_columns_of_trial_toml(tmp_path: Path) -> None:
    """Names are mapped as trial.toml says, left out when mapped to nothing, and checked."""
    path = text_log(tmp_path, "T(s);ES_R(ft);R;range_residual\n1;1;30000;9\n")
    mapping = {"T(s)": "time_s", "ES_R(ft)": "range_residual_ft", "R": "range_predicted_m", "range_residual": ""}
    table = read(path, settings=dialect(columns=mapping))
    assert table.floats("range_residual_m").tolist() == [0.3048]
    with pytest.raises(SettingsError, match=r"residuals.csv: has no column 'TT', which trial.toml names"):
        read(path, settings=dialect(columns={"TT": "time_s"}))
    with pytest.raises(SettingsError, match=r"is 'time_x', which no kind of log has; did you mean 'time_"):
        read(path, settings=dialect(columns={"T(s)": "time_x"}))


def test_residuals_after_the_update_say_so(tmp_path: Path) -> None:
    """residual_stage of trial.toml is the stage of the log."""
    path = text_log(tmp_path, HEADER + ROWS)
    assert open_trial(path).logs[0].stage == "predicted"
    assert open_trial(path, settings=dialect(residual_stage="updated")).logs[0].stage == "updated"


def test_17_digit_numbers_are_exact(tmp_path: Path) -> None:
    """Every float comes back bit for bit from its shortest text."""
    values = np.random.default_rng(5).normal(size=2000) * 10.0 ** np.random.default_rng(6).integers(-30, 30, 2000)
    columns = {"time_s": np.arange(2000.0), "range_residual_m": values, "range_predicted_m": np.full(2000, 3e4)}
    np.testing.assert_array_equal(read(text_log(tmp_path, csv_text(columns))).floats("range_residual_m"), values)


CELL = st.one_of(
    st.floats(allow_nan=False, width=64).map(repr),
    st.sampled_from(["", "NaN", "-", "oops", "1e400", " 1.5", "1,5", '"2"', '"', "a\0b", "\t", "1;2", "−5", "#"]),
    st.text(alphabet="0123456789.eE+- ,\"'x", max_size=6),
)


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.lists(CELL, min_size=1, max_size=6), max_size=12), st.sampled_from(["\n", "\r\n"]))
def test_every_row_is_kept_or_counted(tmp_path: Path, rows: list[list[str]], end: str) -> None:
    """Rows in = rows kept + rows rejected, and what is kept stands in its own columns."""
    body = ["1.5,A,2.5,30000"] * 20  # the header's shape is plain
    body += [",".join(row) for row in rows]
    text = end.join([HEADER.strip(), *body]) + end
    lines = [line for line in "\n".join(body).replace("\r", "\n").split("\n") if line.strip()]
    table = read(text_log(tmp_path, text))
    assert len(table) + sum(p.count for p in table.problems if p.rejected) == len(lines)
    for name, column in zip(("time_s", "range_residual_m"), (0, 2), strict=True):
        told = {cells[column].strip().strip('"') for line in lines if len(cells := split(line)) == 4}
        for value in table.floats(name)[~np.isnan(table.floats(name))].tolist():
            assert any(same_number(cell, value) for cell in told)


def split(line: str) -> list[str]:
    import csv

    return next(csv.reader([line]), [])


def same_number(cell: str, value: float) -> bool:
    try:
        return float(cell) == value
    except ValueError:
        return False
