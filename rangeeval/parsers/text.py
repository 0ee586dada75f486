"""Delimited text: CSV, tab, semicolon, pipe or blanks between fields; gz, zst; any line end; decimal comma.

Every line is a row: quoted fields may hold the delimiter, not a line break. Every row's fields are counted before they
are parsed, since a row with one field more would shift all its columns.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rangeeval.errors import InputError, SettingsError, one_line
from rangeeval.model import Problem
from rangeeval.model.table import MAX_SHOWN
from rangeeval.parsers.blocks import (
    TEXT_IN_NUMBERS,
    Block,
    Coded,
    Contents,
    SourceFile,
    Written,
    log_from,
    not_a_number,
)
from rangeeval.parsers.clock import Clock, is_clock, is_missing
from rangeeval.parsers.columns import Field, Layout, known, lay_out, plain
from rangeeval.parsers.streams import MAX_LINE_BYTES, encoding_of, head_of, lines, one_newline

DELIMITERS = (",", ";", "\t", "|", " ")
BLANKS = " "
_HEAD_BYTES = MAX_LINE_BYTES + (1 << 16)
_SAMPLE_LINES = 100
_NUMBER = re.compile(rb"[+-]?([0-9]+([.][0-9]*)?|[.][0-9]+)([eE][+-]?[0-9]+)?|[+-]?(?:inf|infinity)", re.IGNORECASE)
_MISSING = re.compile(rb"|-?nan|n/a|-", re.IGNORECASE)
NA_VALUES = ("", "NaN", "nan", "NAN", "-nan", "-NaN", "N/A", "n/a", "-")


@dataclass(frozen=True)
class Dialect:
    """How one text log is written.

    `header` is the header's line number. `fields` is how many fields every row must have: the header's, or one more
    (`trailing`) when rows end in a delimiter. `clock` is the position of a time column written as times of day.
    """

    encoding: str
    mark: int
    delimiter: str
    decimal: str
    header: int
    names: tuple[str, ...]
    trailing: bool
    clock: int | None = None

    @property
    def fields(self) -> int:
        """How many fields a row must have."""
        return len(self.names) + self.trailing


def recognises(head: bytes, path: Path) -> bool:
    """Text: a byte order mark, or hardly a byte that text does not have (compressed text is looked into)."""
    if not head:
        return False
    from rangeeval.parsers.streams import compression

    if compression(head):
        head = head_of(path, 1 << 12)
    if encoding_of(head, None)[1]:
        return True
    odd = sum(head.count(bytes([b])) for b in range(32) if b not in b"\t\n\r\f\v")
    return bool(head) and odd <= len(head) // 50


def read(file: SourceFile) -> Contents:
    """The log of a text file; unrecognised when no line near its top names columns that are known."""
    head = head_of(file.path, _HEAD_BYTES)
    whole = len(head) < _HEAD_BYTES
    found = _header(file, head)
    if isinstance(found, str):
        return Contents(unrecognised=found)
    encoding, mark, delimiter, at, names, top = found
    layout = lay_out(names, file.name, file.kind, file.columns)
    if layout is None:
        return Contents(unrecognised="its header names no column of a known kind of log")
    sample = [(n, line) for n, line in enumerate(top[at:], at + 1) if line.strip()][: _SAMPLE_LINES + 1]
    if not whole and len(sample) <= _SAMPLE_LINES:
        sample = sample[:-1]
    sample = sample[:_SAMPLE_LINES]
    trailing = _trailing(file, names, delimiter, sample)
    decimal = _decimal(file, layout, delimiter, sample)
    dialect = Dialect(encoding, mark, delimiter, decimal, at, names, trailing, _clock(layout, delimiter, sample))
    written = Written(
        file.name,
        names,
        lambda fields: _blocks(file, dialect, fields),
        lambda row: f"{file.name}:{row}",
    )
    return Contents((log_from(written, layout, file),), layout.problems)


def _split(line: str, delimiter: str) -> list[str]:
    """The fields of one line."""
    if delimiter == BLANKS:
        return line.split()
    try:
        return next(csv.reader([line], delimiter=delimiter), [])
    except csv.Error:
        return line.split(delimiter)


def _header(file: SourceFile, head: bytes) -> tuple[str, int, str, int, tuple[str, ...], list[str]] | str:
    """Encoding, mark, delimiter, line number and names of the header, and the top lines; or why there is none."""
    settings = file.settings
    encoding, mark = encoding_of(head, settings.encoding if settings else None)
    try:
        text = head[mark:].decode(encoding, "replace")
    except LookupError:
        raise SettingsError(f"{file.name}: encoding '{one_line(encoding, 40)}' in trial.toml is not known") from None
    top = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    skip = settings.skip_rows if settings else 0
    comment: int | None = None
    for i, line in enumerate(top[skip:], skip):
        if not line.strip():
            continue
        if line.lstrip().startswith("#"):
            comment = i
            continue
        delimiter, names = _best_split(file, line)
        if not _meant(file, names) and comment is not None:  # numpy.savetxt writes its header as a comment
            other, commented = _best_split(file, top[comment].lstrip().lstrip("#"))
            if _meant(file, commented):
                return encoding, mark, other, comment + 1, tuple(commented), top
        if len(line.encode("utf-8", "replace")) > MAX_LINE_BYTES:
            return "its first line is longer than 1 MB"
        return encoding, mark, delimiter, i + 1, tuple(names), top
    if not text.strip():
        if settings is not None:
            raise InputError(f"{file.name}: the file is empty")
        return "it is empty"
    return "it has no header line"


def _meant(file: SourceFile, names: Sequence[str]) -> int:
    mapped = {plain(written) for written in file.columns}
    return known(names) + sum(plain(name) in mapped for name in names)


def _best_split(file: SourceFile, line: str) -> tuple[str, list[str]]:
    given = file.settings.delimiter if file.settings else None
    if given is not None:
        if not given.isascii():
            raise SettingsError(f"{file.name}: delimiter '{one_line(given, 10)}' in trial.toml is not ASCII")
        return given, _split(line, given)
    splits = [(d, _split(line, d)) for d in DELIMITERS]
    return max(splits, key=lambda s: (_meant(file, s[1]), len(s[1]) if s[0] != BLANKS else 0))


def _trailing(file: SourceFile, names: Sequence[str], delimiter: str, sample: Sequence[tuple[int, str]]) -> bool:
    """Whether rows end in a delimiter that the header lacks. Raises InputError when most rows do not fit the header."""
    if not sample:
        return False
    split = [(n, line, _split(line, delimiter)) for n, line in sample]
    widths = [len(fields) for _, _, fields in split]
    usual = max(set(widths), key=lambda w: (widths.count(w), -w))
    if usual == len(names):
        return False
    if usual == len(names) + 1 and all(not f[-1].strip() for _, _, f in split if len(f) == usual):
        return True
    n, line, _ = next(s for s in split if len(s[2]) == usual)
    hint = ""
    if delimiter == "," and usual > len(names):
        hint = "; a decimal comma needs another delimiter"
    raise InputError(
        f"{file.name}:{n}: the row has {usual} fields, the header names {len(names)} columns{hint}: "
        f"'{one_line(line.strip(), 100)}'"
    )


_COMMA = re.compile(r"[+-]?[0-9]*,[0-9]+([eE][+-]?[0-9]+)?")
_GROUPED = re.compile(r"[+-]?[1-9][0-9]{0,2},[0-9]{3}")
_MIXED = re.compile(r"[+-]?[0-9]{1,3}([.,' ][0-9]{3})+[.,][0-9]*|[+-]?[0-9]{1,3}([,'][0-9]{3}){2,}")
_POINT = re.compile(r"[+-]?[0-9]*\.[0-9]+([eE][+-]?[0-9]+)?")


def _decimal(file: SourceFile, layout: Layout, delimiter: str, sample: Sequence[tuple[int, str]]) -> str:
    """The decimal sign. Raises InputError when a number could be read in two ways, showing the line."""
    given = file.settings.decimal if file.settings else "."
    if given != "." or delimiter == ",":
        return given
    commas: list[tuple[int, str, str]] = []
    points = clear = 0
    for n, line in sample:
        fields = _split(line, delimiter)
        for f in layout.fields:
            cell = fields[f.position].strip() if f.position < len(fields) and not f.text else ""
            if "," not in cell and not _POINT.fullmatch(cell):
                continue
            if _MIXED.fullmatch(cell) and ("," in cell and ("." in cell or cell.count(",") > 1)):
                raise InputError(
                    f"{file.name}:{n}: {one_line(f.written, 60)} is '{one_line(cell, 40)}': digits in groups are not "
                    f"read; write it without the grouping sign"
                )
            if _COMMA.fullmatch(cell):
                commas.append((n, f.written, cell))
                clear += not _GROUPED.fullmatch(cell)
            elif _POINT.fullmatch(cell):
                points += 1
    if not commas or (points and len(commas) <= (points + len(commas)) // 10):
        return "."  # a few commas among points: those rows are left out, with their line
    n, column, cell = commas[0]
    if points or not clear:
        why = "others have a decimal point" if points else "it may be a decimal comma or digits in groups"
        raise InputError(
            f"{file.name}:{n}: {one_line(column, 60)} is '{one_line(cell, 40)}', and {why}; "
            f'say decimal = "," or decimal = "." for this file under [[logs]] in trial.toml'
        )
    return ","


def _clock(layout: Layout, delimiter: str, sample: Sequence[tuple[int, str]]) -> int | None:
    """The position of the time column when most of its cells are times of day."""
    for f in layout.fields:
        if f.name == "time_s":
            rows = [_split(line, delimiter) for _, line in sample]
            cells = [row[f.position] for row in rows if f.position < len(row) and not is_missing(row[f.position])]
            return f.position if cells and 2 * sum(map(is_clock, cells)) > len(cells) else None
    return None


# --- rows ------------------------------------------------------------------------------------------------------------


def _blocks(file: SourceFile, dialect: Dialect, fields: Sequence[Field]) -> Iterator[Block]:
    parser = _Parser(file, dialect, fields)
    for first, count, block in lines(file.path, file.name, dialect.encoding, dialect.mark):
        if first + count - 1 <= dialect.header:
            continue
        if first <= dialect.header:
            for _ in range(dialect.header - first + 1):
                block = block[block.index(b"\n") + 1 :]
            count -= dialect.header - first + 1
            first = dialect.header + 1
        if block:
            yield parser.parse(first, count, block)


class _Parser:
    """Parses blocks of whole lines of one dialect into the wanted columns."""

    def __init__(self, file: SourceFile, dialect: Dialect, fields: Sequence[Field]) -> None:
        self.name = file.name
        self.dialect = dialect
        self.fields = fields
        self.separator = ord(" " if dialect.delimiter == BLANKS else dialect.delimiter)
        self.order = sorted(range(len(fields)), key=lambda i: fields[i].position)
        self.clock = Clock()

    def parse(self, first: int, count: int, block: bytes) -> Block:
        """The rows of a block; those that cannot be used are left out and named."""
        if not block.isascii():
            self._check_utf8(first, block)
        if self.dialect.delimiter == BLANKS:
            block = re.sub(rb"[ \t]+", b" ", block)
            block = re.sub(rb"(?m)^ | $", b"", block)
        problems: list[Problem] = []
        rows: NDArray[np.int64] | None = None
        good = block
        if not self._fits(count, block):
            good, rows, problems = self._fitting(first, block)
        columns, kept, more = self._columns(good, first, rows)
        if kept is not None:
            rows = (np.arange(first, first + len(kept)) if rows is None else rows)[kept]
        return Block(columns, first if rows is None else rows, (*problems, *more))

    def _check_utf8(self, first: int, block: bytes) -> None:
        try:
            block.decode("utf-8")
        except UnicodeDecodeError as error:
            line = first + block.count(b"\n", 0, error.start)
            raise InputError(
                f"{self.name}:{line}: byte 0x{block[error.start]:02x} is not UTF-8 text; "
                f'say which encoding it is for this file under [[logs]] in trial.toml (encoding = "cp949")'
            ) from None

    def _fits(self, count: int, block: bytes) -> bool:
        """Whether every line has the right number of fields, no quote and no NUL: the usual case, at memory speed."""
        if b'"' in block or b"\0" in block:
            return False
        bytes_ = np.frombuffer(block, np.uint8)
        ends = np.flatnonzero((bytes_ == self.separator) | (bytes_ == 10))
        width = self.dialect.fields
        if len(ends) % width:
            return False
        last = ends[width - 1 :: width]
        # Every width-th mark is a line's end, and there are no more line ends than those: no row is longer or shorter.
        if not bool((bytes_[last] == 10).all()) or len(last) != count:
            return False
        if width == 1 and (len(last) < 2 or int(np.diff(last).min()) < 2):
            return False  # a blank line is no row
        if self.dialect.trailing and not bool((last - ends[width - 2 :: width] == 1).all()):
            return False
        return len(block) < MAX_LINE_BYTES or int(np.diff(last, prepend=-1).max()) <= MAX_LINE_BYTES

    def _fitting(self, first: int, block: bytes) -> tuple[bytes, NDArray[np.int64], list[Problem]]:
        """The lines that have the right fields, their numbers, and what is wrong with the others."""
        bytes_ = np.frombuffer(block, np.uint8)
        ends = np.flatnonzero(bytes_ == 10)
        starts = np.concatenate([[0], ends[:-1] + 1])
        if (lengths := ends - starts).max() > MAX_LINE_BYTES:
            raise InputError(
                f"{self.name}:{first + int(lengths.argmax())}: this line is longer than 1 MB; is it a text log?"
            )

        def per_line(positions: NDArray[np.intp]) -> NDArray[np.intp]:
            return np.asarray(np.diff(np.searchsorted(positions, ends), prepend=0), np.intp)

        quotes = np.flatnonzero(bytes_ == 34)
        nul = per_line(np.flatnonzero(bytes_ == 0)) > 0
        unquoted = self._badly_quoted(bytes_, quotes, per_line(quotes), starts, ends)
        separators = np.flatnonzero(bytes_ == self.separator)
        if len(quotes):
            even = ~np.isin(np.searchsorted(ends, quotes), np.flatnonzero(unquoted))
            inside = np.searchsorted(quotes[even], separators) & 1
            separators = separators[inside == 0]
        widths = per_line(separators) + 1
        blank = np.zeros(len(ends), bool)
        for i in np.flatnonzero(widths == 1).tolist():
            blank[i] = not block[starts[i] : ends[i]].strip()
        wrong = (widths != self.dialect.fields) & ~blank & ~nul & ~unquoted
        if self.dialect.trailing:
            # A value beyond the header's last name: a name was lost, and which one nobody can tell.
            beyond = ~blank & ~nul & ~unquoted & ~wrong & (bytes_[np.maximum(ends - 1, 0)] != self.separator)
            if beyond.any():
                line = int(beyond.argmax())
                raise InputError(
                    f"{self.name}:{first + line}: the row has {self.dialect.fields} fields, "
                    f"the header names {len(self.dialect.names)} columns"
                )
        problems: list[Problem] = []
        self._note(problems, first, nul & ~blank, "rows with a NUL byte", lambda i: "holds a NUL byte")
        self._note(
            problems,
            first,
            unquoted & ~nul,
            "rows with a quotation mark that is not closed or stands inside a field",
            lambda i: "a quotation mark is not closed or stands inside a field",
        )
        expected = len(self.dialect.names)
        self._note(
            problems,
            first,
            wrong,
            "rows with too few or too many fields",
            lambda i: (
                f"the row has {int(widths[i])} fields, expected {expected}"
                + (" and a delimiter at the end" if self.dialect.trailing else "")
            ),
        )
        good = ~(blank | nul | unquoted | wrong)
        kept = np.flatnonzero(good)
        if good.all():
            return block, first + kept, problems
        # Neighbouring good lines are copied together.
        edges = np.flatnonzero(np.diff(good.astype(np.int8), prepend=0, append=0))
        parts = [block[starts[a] : ends[b - 1] + 1] for a, b in zip(edges[::2], edges[1::2], strict=True)]
        return b"".join(parts), first + kept, problems

    def _badly_quoted(
        self,
        bytes_: NDArray[np.uint8],
        quotes: NDArray[np.intp],
        per_line: NDArray[np.intp],
        starts: NDArray[np.intp],
        ends: NDArray[np.intp],
    ) -> NDArray[np.bool_]:
        """Lines whose quotation marks are odd in number, or not at the ends of a field (or doubled inside one)."""
        bad = np.asarray((per_line & 1) == 1)
        if not len(quotes):
            return bad
        line = np.searchsorted(ends, quotes)
        quotes, line = quotes[~bad[line]], line[~bad[line]]
        opening, closing = quotes[0::2], quotes[1::2]
        field_ends = (self.separator, 10, 34)
        before = np.where(opening == 0, 10, bytes_[np.maximum(opening - 1, 0)])
        after = bytes_[closing + 1]
        wrong = ~np.isin(before, field_ends) | ~np.isin(after, field_ends)
        # A doubled mark outside quotes ('a""b') opens right after a plain character, so it is caught by `before`.
        bad[line[0::2][wrong]] = True
        return bad

    def _note(self, problems: list[Problem], first: int, rows: NDArray[np.bool_], reason: str, what: Any) -> None:
        which = np.flatnonzero(rows)
        if len(which):
            examples = tuple(f"{self.name}:{first + int(i)}: {what(i)}" for i in which[:MAX_SHOWN])
            problems.append(Problem(self.name, reason, len(which), examples, rejected=True))

    # --- values ------------------------------------------------------------------------------------------------------

    def _columns(
        self, block: bytes, first: int, rows: NDArray[np.int64] | None
    ) -> tuple[list[NDArray[Any] | Coded], NDArray[np.bool_] | None, list[Problem]]:
        """The wanted columns of lines that fit; the mask of kept rows when some had to go; and why."""
        if not block:
            return [Coded(np.empty(0, np.int32), ()) if f.text else np.empty(0) for f in self.fields], None, []
        try:
            return self._parsed(block), None, []
        except (ValueError, OverflowError):
            pass
        kept, problems = self._numeric_lines(block, first, rows)
        good = block
        if not kept.all():
            good = b"".join(line for line, keep in zip(block.splitlines(keepends=True), kept, strict=True) if keep)
            if not good:
                return self._columns(b"", first, None)[0], kept, problems
        try:
            return self._parsed(good), kept, problems
        except (ValueError, OverflowError):
            return self._parsed_slowly(good), kept, problems

    def _parsed(self, block: bytes) -> list[NDArray[Any] | Coded]:
        import pandas as pd

        wanted = [self.fields[i] for i in self.order]
        clock = self.dialect.clock
        dtype: Any = {f.position: "category" if f.text else str if f.position == clock else np.float64 for f in wanted}
        # Below 3.1, pandas reads a third of 17-digit numbers one ulp off unless asked not to.
        exact: Any = {"float_precision": "round_trip"} if _older(pd.__version__, (3, 1)) else {}
        frame = pd.read_csv(
            io.BytesIO(block),
            sep=" " if self.dialect.delimiter == BLANKS else self.dialect.delimiter,
            header=None,
            names=list(range(self.dialect.fields)),
            usecols=sorted(dtype),
            index_col=False,
            dtype=dtype,
            na_values={position: list(NA_VALUES) for position in dtype if position != clock},
            keep_default_na=False,
            quoting=csv.QUOTE_MINIMAL if b'"' in block else csv.QUOTE_NONE,
            decimal=self.dialect.decimal,
            skip_blank_lines=False,
            engine="c",
            low_memory=False,
            encoding="utf-8",
            **exact,
        )
        found: list[NDArray[Any] | Coded] = []
        for f in self.fields:
            column = frame[f.position]
            if f.text:
                found.append(Coded(column.cat.codes.to_numpy(), list(column.cat.categories)))
            elif f.position == clock:
                found.append(self._seconds(column.tolist()))
            else:
                found.append(column.to_numpy())
        return found

    def _seconds(self, cells: Sequence[object]) -> NDArray[np.float64]:
        """Seconds of times of day; the clock moves on only when all of them are."""
        clock = self.clock.copy()
        seconds = clock.seconds(cells)
        self.clock = clock
        return seconds

    def _cells(self, line: bytes) -> list[bytes]:
        separator = bytes([self.separator])
        if b'"' not in line:
            return line.split(separator)
        text = next(csv.reader([line.decode("utf-8")], delimiter=chr(self.separator)))
        return [cell.encode("utf-8") for cell in text]

    def _line_of_numbers(self) -> re.Pattern[bytes]:
        """What a line looks like whose number columns plainly hold numbers: most lines need no closer look."""
        separator = re.escape(bytes([self.separator]))
        point = b"," if self.dialect.decimal == "," else b"[.]"
        digits = b"(?:[0-9]+(?:%s[0-9]*)?|%s[0-9]+)" % (point, point)
        number = b"(?:[+-]?%s(?:[eE][+-]?[0-9]+)?)?" % digits
        wanted = {f.position for f in self.fields if not f.text and f.position != self.dialect.clock}
        cells = (number if i in wanted else b'[^"%s]*' % separator for i in range(self.dialect.fields))
        return re.compile(separator.join(cells))

    def _numeric_lines(
        self, block: bytes, first: int, rows: NDArray[np.int64] | None
    ) -> tuple[NDArray[np.bool_], list[Problem]]:
        """Which lines hold numbers in all number columns."""
        all_lines = block[:-1].split(b"\n")
        kept = np.ones(len(all_lines), bool)
        examples: list[str] = []
        numbers = [f for f in self.fields if not f.text]
        comma = self.dialect.decimal == ","
        plainly_good = self._line_of_numbers().fullmatch
        clock = self.dialect.clock
        timed = any(f.position == clock for f in numbers)
        for i, line in enumerate(all_lines):
            if not timed and plainly_good(line):
                continue
            cells = self._cells(line)
            for f in numbers:
                cell = cells[f.position].strip()
                if f.position == clock:
                    text = cell.decode("utf-8", "replace")
                    if is_clock(text) or is_missing(text):
                        continue
                plain_cell = cell if f.position != clock else b"x"
                if comma:
                    plain_cell = b"x" if b"." in cell else cell.replace(b",", b".")
                if not (_NUMBER.fullmatch(plain_cell) or _MISSING.fullmatch(cell)):
                    kept[i] = False
                    if len(examples) < MAX_SHOWN:
                        line_number = first + i if rows is None else int(rows[i])
                        shown = cell.decode("utf-8", "replace")
                        what = "a time of day, as the others are" if f.position == clock else "a number"
                        examples.append(not_a_number(f"{self.name}:{line_number}", f.written, shown, what))
                    break
        bad = len(kept) - int(np.count_nonzero(kept))
        if not bad:
            return kept, []
        return kept, [Problem(self.name, TEXT_IN_NUMBERS, bad, tuple(examples), rejected=True)]

    def _parsed_slowly(self, block: bytes) -> list[NDArray[Any] | Coded]:
        """The same cell by cell, for numbers with blanks around them and the like, which the fast parser refuses."""
        cells = [self._cells(line) for line in block[:-1].split(b"\n")]
        found: list[NDArray[Any] | Coded] = []
        for f in self.fields:
            texts = [row[f.position].strip() for row in cells]
            if f.text:
                found.append(np.array([t.decode("utf-8") for t in texts], dtype=object))
                continue
            if f.position == self.dialect.clock:
                found.append(self._seconds([t.decode("utf-8", "replace") for t in texts]))
                continue
            point = (t.replace(b",", b".") if self.dialect.decimal == "," else t for t in texts)
            found.append(np.array([np.nan if _MISSING.fullmatch(t) else float(t) for t in point], dtype=np.float64))
        return found


def _older(version: str, than: tuple[int, int]) -> bool:
    major, minor = version.split(".")[:2]
    return (int(major), int(minor)) < than


__all__ = ["Dialect", "one_newline", "read", "recognises"]
