"""Every format gives the same table, whatever the file is called."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import rangeeval
from rangeeval.errors import InputError, MissingExtra, SettingsError
from rangeeval.parsers import FORMATS, open_trial, sha256_of
from tests.parsers.samples import COLUMNS, SAMPLES, compressed, csv_text, same, text_log, write_hdf5

# SAC files hold samples of one sensor (test_snapshots.py), ASTERIX recordings plots and truth (test_asterix.py), a binary
# log needs trial.toml (test_binary.py).
TABLES = sorted(set(FORMATS) - {"sac", "asterix", "pcap", "binary"})


@pytest.mark.parametrize("name", TABLES)
def test_each_format_gives_the_same_table(name: str, tmp_path: Path) -> None:
    """A log read from any format is the same columns, values and labels, recognised without its file's name."""
    path = tmp_path / "no_ending"
    SAMPLES[name](path)
    trial = open_trial(path)
    assert [source.format for source in trial.sources] == [name]
    assert trial.problems == ()
    table = trial.log("residuals").read()
    assert table.problems == ()
    same(table)


@pytest.mark.parametrize("name", TABLES)
def test_each_format_reads_only_the_columns_asked_for(name: str, tmp_path: Path) -> None:
    """Asking for some columns gives those, with the same values."""
    path = tmp_path / "log"
    SAMPLES[name](path)
    table = open_trial(path).logs[0].read(["y_residual_m", "track_id"])
    same(table, {n: COLUMNS[n] for n in ("track_id", "y_residual_m")})


@pytest.mark.parametrize("name", TABLES)
@pytest.mark.parametrize("keep", [0.3, 0.6, 0.95])
def test_each_format_names_a_file_that_was_cut_off(name: str, keep: float, tmp_path: Path) -> None:
    """A file cut off anywhere is one clear line that names it, or (text) its last row is counted as rejected."""
    path = tmp_path / "cut"
    SAMPLES[name](path)
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * keep)])
    if name == "text" and keep > 0.5:  # of the shortest, not one row has the header's fields: that is an error
        table = open_trial(path).logs[0].read()
        assert len(table) + sum(p.count for p in table.problems) == data[: int(len(data) * keep)].count(b"\n")
        return
    with pytest.raises(InputError, match=r"^cut:") as caught:
        open_trial(path).logs[0].read()
    assert "\n" not in str(caught.value)


def test_a_trial_folder_is_read_with_what_trial_toml_says(tmp_path: Path) -> None:
    """Own files and those of [[logs]] are logs; hidden files and reports are not; strange files are listed."""
    folder = tmp_path / "pass 3"
    (folder / "legacy").mkdir(parents=True)
    write_hdf5(folder / "data.bin")
    (folder / "legacy" / "ES.txt").write_text("made by ES\nT(s);A;B\n100,125;0,5;0,25\n", encoding="utf-8")
    (folder / "legacy" / "unused.csv").write_text("time_s,alpha\n1,2\n", encoding="utf-8")
    (folder / ".hidden.csv").write_text("time_s,alpha\n1,2\n", encoding="utf-8")
    (folder / "notes.txt").write_text("windy\n", encoding="utf-8")
    (folder / "results.json").write_text("{}", encoding="utf-8")
    (folder / "plot.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    (folder / "trial.toml").write_text(
        '[trial]\nname = "Inbound"\n[[logs]]\nfile = "legacy/ES.txt"\nskip_rows = 1\ndelimiter = ";"\ndecimal = ","\n'
        'columns = { "T(s)" = "time_s", A = "alpha", B = "beta" }\n',
        encoding="utf-8",
    )
    trial = rangeeval.open_trial(folder)
    assert trial.title == "Inbound"
    assert [(s.name, s.kind) for s in trial.sources] == [("data.bin", "residuals"), ("legacy/ES.txt", "gains")]
    assert [p.where for p in trial.problems] == ["pass 3/notes.txt"]
    gains = trial.log("gains").read()
    assert gains.floats("time_s").tolist() == [100.125]
    assert gains.floats("beta").tolist() == [0.25]
    assert gains.first_row == 3
    assert all(len(digest) == 64 for digest in sha256_of(trial.sources).values())


def test_several_files_make_one_trial(tmp_path: Path) -> None:
    """Log files given one by one are a trial named after their folder."""
    one = text_log(tmp_path, csv_text(), "a.csv")
    two = text_log(tmp_path, "time_s,alpha,beta\n1,0.5,0.1\n", "b.csv")
    trial = open_trial([one, two])
    assert trial.name == tmp_path.name
    assert {log.kind for log in trial.logs} == {"residuals", "gains"}


def test_what_cannot_be_opened_is_one_clear_line(tmp_path: Path) -> None:
    """No such file, nothing recognised, a folder among files: an InputError in one line."""
    with pytest.raises(InputError, match="no such file or folder"):
        open_trial(tmp_path / "nowhere")
    with pytest.raises(InputError, match="no log was recognised in it"):
        open_trial(tmp_path)
    (tmp_path / "notes.txt").write_text("windy\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"no log was recognised in it .*notes.txt: not recognised as a log"):
        open_trial(tmp_path)
    with pytest.raises(InputError, match=r"notes.txt: not recognised as a log: its header names no column"):
        open_trial(tmp_path / "notes.txt")
    with pytest.raises(InputError, match="give one trial folder or log files"):
        open_trial([tmp_path, tmp_path / "notes.txt"])


@pytest.mark.parametrize(
    ("toml", "says"),
    [
        ("[trial\n", r"trial.toml: .*line 1"),
        ('[[logs]]\nfile = "none.csv"\n', r"\[\[logs\]\] file 'none.csv' does not exist"),
        ('[[logs]]\nfile = "../x.csv"\n', r"is not inside the folder|is outside the trial's folder"),
        ('[[logs]]\nfile = "/etc/passwd"\n', r"is outside the trial's folder"),
        ('[trial]\nnam = "x"\n', r"unknown key 'nam'; did you mean 'name'"),
        ("name = 'caf\xe9'\n", r"trial.toml:1: is not UTF-8 text"),
    ],
)
def test_a_wrong_trial_toml_is_one_clear_line(toml: str, says: str, tmp_path: Path) -> None:
    """Syntax errors give the line; files of [[logs]] must exist, inside the folder."""
    text_log(tmp_path, csv_text())
    (tmp_path / "trial.toml").write_bytes(toml.encode("latin-1"))
    with pytest.raises(SettingsError, match=says) as caught:
        open_trial(tmp_path)
    assert "\n" not in str(caught.value)


def test_a_format_that_needs_an_extra_says_which(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without pyarrow or zstd, the line names the extra to install."""
    SAMPLES["parquet"](tmp_path / "p")
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(MissingExtra, match=r"rangeeval\[parquet\]"):
        open_trial(tmp_path / "p")
    (tmp_path / "z").write_bytes(compressed(csv_text().encode(), "zst"))
    for name in ("compression", "backports", "backports.zstd"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingExtra, match=r"rangeeval\[zstd\]"):
        open_trial(tmp_path / "z")


def test_pieces_are_even_whatever_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pieces have exactly CHUNK_ROWS rows, the last one fewer, and a label keeps its code from piece to piece."""
    from rangeeval.parsers import blocks, hdf5, numpy_files, streams

    for module in (blocks, hdf5):
        monkeypatch.setattr(module, "CHUNK_ROWS", 7)
    monkeypatch.setattr(numpy_files, "CHUNK_ROWS", 5)
    monkeypatch.setattr(streams, "BLOCK_BYTES", 64)
    n = 45
    columns = {
        "time_s": np.arange(n) / 8,
        "track_id": np.array([f"T{i // 4}" for i in range(n)]),
        "range_residual_m": np.where(np.arange(n) % 11 == 5, np.inf, 1.0),
        "range_predicted_m": np.full(n, 1e4),
    }
    write_hdf5(tmp_path / "h")
    with (tmp_path / "n").open("wb") as file:
        np.savez(file, **columns)
    (tmp_path / "h").unlink()
    write_hdf5(tmp_path / "h", columns)
    text_log(tmp_path, csv_text(columns), "t")
    tables = []
    for name in "hnt":
        pieces = list(open_trial(tmp_path / name).logs[0].pieces(None))
        assert [len(p) for p in pieces] == [7, 7, 7, 7, 7, 6]
        codes: dict[str, int] = {}
        for piece in pieces:
            for code, text in zip(piece.codes("track_id").tolist(), piece.texts("track_id"), strict=True):
                assert codes.setdefault(text, code) == code
        tables.append([(p.floats("time_s").tolist(), p.texts("track_id")) for p in pieces])
        assert sum(p.count for piece in pieces for p in piece.problems if p.rejected) == 4
    assert tables[0] == tables[1] == tables[2]


def test_importing_the_package_is_light() -> None:
    """`import rangeeval` loads neither numpy nor a parser."""
    import subprocess

    code = "import sys, rangeeval; print([m for m in ('numpy', 'rangeeval.parsers') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = rangeeval.nothing
