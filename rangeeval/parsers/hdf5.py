"""HDF5: datasets of a group as columns, a compound dataset, a 2-D dataset with a `columns` attribute, or array samples.

A file is first looked into by a child process (`safe`), which refuses what could read other files or run code:
external links, external storage, virtual datasets, filters beyond the standard ones, object references.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rangeeval.errors import InputError, one_line
from rangeeval.model import CHUNK_ROWS
from rangeeval.parsers import safe, samples
from rangeeval.parsers.blocks import Block, Contents, Reader, SourceFile
from rangeeval.parsers.columns import Field
from rangeeval.parsers.found import Described, contents

MAGIC = b"\x89HDF\r\n\x1a\n"
MAX_DEPTH = 32
MAX_OBJECTS = 100_000
MAX_CHUNK_BYTES = 256 << 20
_CACHE_BYTES = 128 << 20
# deflate, shuffle, fletcher32, szip, and h5py's own lzf; any other is code loaded from a path.
FILTERS = frozenset({1, 2, 3, 4, 32000})
# deflate cannot do better than 1032 to 1; a file that declares more holds rows that were never written.
_MOST_EXPANSION = 1100
_SMALL = 64 << 20
READ_IN_CHILD = 1 << 20
_SHUFFLE, _FLETCHER32 = 2, 3


def recognises(head: bytes, path: Path) -> bool:
    """The HDF5 signature at the start, or after a user block."""
    return head.startswith(MAGIC) or (len(head) >= 520 and head[512:520] == MAGIC and not head.startswith(b"MATLAB"))


def read(file: SourceFile) -> Contents:
    """The logs of an HDF5 file: every group whose datasets make one, every compound or 2-D table that does."""
    looked = safe.call(__name__, "audit", str(file.path), file.name)
    nothing = "no group of datasets, compound or 2-D dataset in it has the columns of a log"
    return contents(
        file,
        looked,
        lambda where, table, usable: _reader(file.path, where, table, usable),
        lambda where, found: _opened(file.path, where, found),
        nothing,
    )


def _opened(path: Path, where: str, found: Described) -> samples.Opened:
    """The snapshots of a group: one dataset, or two of real and imaginary part."""

    @contextlib.contextmanager
    def opened() -> Iterator[samples.ReadRows]:
        import h5py

        try:
            with open_file(h5py, path) as file:
                parts = [file[name] for name in found["datasets"]]
                times = file[found["time_path"]] if found["time"] else None

                def read_rows(start: int, stop: int) -> tuple[NDArray[Any] | None, NDArray[Any]]:
                    try:
                        values = [samples.as_complex(part[start:stop]) for part in parts]
                        time = None if times is None else times[start:stop]
                    except (OSError, RuntimeError, ValueError, KeyError, TypeError) as error:
                        raise InputError(
                            f"{where}: rows {start} to {stop - 1} cannot be read, the file is damaged or cut off "
                            f"({one_line(error, 120)})"
                        ) from error
                    return time, samples.joined(values)

                yield read_rows
        except (OSError, RuntimeError, KeyError) as error:
            raise InputError(f"{where}: cannot be opened ({one_line(error, 120)})") from error

    return opened


def open_file(h5py: Any, path: str | Path, **options: Any) -> Any:
    """The file, also where it lies on a share without locks; HDF5 wants the same answer of all who have it open."""
    try:
        return h5py.File(path, "r", **options)
    except OSError as error:
        if "lock" not in str(error):
            raise
        return h5py.File(path, "r", locking=False, **options)


def _reader(path: Path, where: str, table: Described, usable: Sequence[Described]) -> Reader:
    def blocks(fields: Sequence[Field]) -> Iterator[Block]:
        import h5py

        wanted = [usable[f.position] for f in fields]
        rows = wanted[0]["rows"]
        chunk_bytes = [c["chunk_bytes"] for c in wanted if CHUNK_ROWS % max(c["chunk_rows"], 1)]
        # Pieces that cut a stored chunk would decompress it twice; one chunk a column is kept when that is cheap.
        options = {}
        if chunk_bytes and sum(chunk_bytes) <= _CACHE_BYTES:
            options = {"rdcc_nbytes": max(1 << 20, *chunk_bytes), "rdcc_nslots": 101, "rdcc_w0": 1.0}
        try:
            with open_file(h5py, path, **options) as f:
                read_piece = _table_pieces(f, table, wanted) if table["form"] != "group" else _piece(f, wanted)
                for start in range(0, rows, CHUNK_ROWS):
                    stop = min(rows, start + CHUNK_ROWS)
                    try:
                        yield Block(read_piece(start, stop), start)
                    except (OSError, RuntimeError, ValueError, KeyError, TypeError, OverflowError) as error:
                        raise InputError(
                            f"{where}: rows {start} to {stop - 1} cannot be read, the file is damaged or cut off "
                            f"({one_line(error, 120)})"
                        ) from error
        except (OSError, RuntimeError, KeyError) as error:
            raise InputError(f"{where}: cannot be opened ({one_line(error, 120)})") from error

    return blocks


def _piece(file: Any, wanted: Sequence[Described]) -> Any:
    datasets = [file[c["path"]] for c in wanted]

    def read_piece(start: int, stop: int) -> list[NDArray[Any]]:
        columns = []
        for dataset, column in zip(datasets, wanted, strict=True):
            if list(dataset.shape) != column["shape"]:
                raise InputError(f"{column['path']}: the file changed while it was read")
            place: Any = np.s_[start:stop]
            if len(dataset.shape) == 2:
                place = (0, place) if column["across"] else (place, 0)
            if column["kind"] == "number" and dataset.dtype.kind != "b":
                values: NDArray[Any] = np.empty(stop - start, dataset.dtype)
                dataset.read_direct(values, place)
                columns.append(values)
            else:
                columns.append(dataset[place])
        return columns

    return read_piece


def _table_pieces(file: Any, table: Described, wanted: Sequence[Described]) -> Any:
    dataset = file[table["path"]]

    def read_piece(start: int, stop: int) -> list[NDArray[Any]]:
        if table["form"] == "compound":
            names = [c["name"] for c in wanted]
            rows = dataset.fields(names)[start:stop]
            return [np.ascontiguousarray(rows[name]) for name in names]
        block = dataset[start:stop]
        return [np.ascontiguousarray(block[:, c["index"]]) for c in wanted]

    return read_piece


# --- in the child ----------------------------------------------------------------------------------------------------


def audit(path: str) -> dict[str, Any]:
    """What an HDF5 file holds that could be a log, as plain values. Raises InputError for what is refused.

    Every object that reading will open is opened here first, and the index of its chunks walked: what crashes the
    HDF5 library, or sends it round in circles, does so in the process that calls this.
    """
    audit_ = _Audit(path)
    with audit_.file:
        audit_.group(audit_.file, "/", 0)
    return {"tables": audit_.tables, "notes": audit_.notes, "arrays": audit_.arrays}


class Audited:
    """An HDF5 file in the child: what may be opened of it. Raises InputError for what is refused."""

    def __init__(self, path: str, **options: Any) -> None:
        import h5py

        self.h5py = h5py
        try:
            self.file = open_file(h5py, path, **options)
        except OSError as error:
            text = str(error)
            if "truncated" in text:
                raise InputError(f"the file is truncated ({one_line(text, 200)})") from None
            raise InputError(f"the file is damaged or not HDF5 ({one_line(text, 200)})") from None
        self.size = self.file.id.get_filesize()
        self.seen: set[Any] = {h5py.h5o.get_info(self.file.id).addr}
        self.notes: list[str] = []

    def members(self, group: Any, path: str, depth: int) -> Iterator[tuple[str, str, Any]]:
        """Name, path and object of what a group holds itself; a group that was met before is not met again."""
        if depth > MAX_DEPTH:
            raise InputError(f"groups are nested deeper than {MAX_DEPTH}")
        h5 = self.h5py
        for name in group:
            here = f"{path.rstrip('/')}/{name}"
            link = group.id.links.get_info(name.encode("utf-8", "surrogateescape"))
            if link.type == h5.h5l.TYPE_EXTERNAL:
                raise InputError(f"'{one_line(here, 100)}' is a link to another file; such files are not read")
            if link.type != h5.h5l.TYPE_HARD:
                self.notes.append(f"the soft link '{one_line(here, 100)}' is not followed")
                continue
            item = group[name]
            address = h5.h5o.get_info(item.id).addr
            if address in self.seen and not isinstance(item, h5.Dataset):
                continue
            self.seen.add(address)
            if len(self.seen) > MAX_OBJECTS:
                raise InputError(f"it holds more than {MAX_OBJECTS} objects")
            yield name, here, item

    def look(self, dataset: Any, path: str) -> tuple[int, int]:
        """Look at how a dataset is stored, and at every stored chunk; rows and bytes of a chunk (0 for none)."""
        shown = one_line(path, 100)
        plist = dataset.id.get_create_plist()
        if plist.get_layout() == self.h5py.h5d.VIRTUAL:
            raise InputError(f"'{shown}' is a virtual dataset, which reads other files; such files are not read")
        if plist.get_external_count() > 0:
            raise InputError(f"'{shown}' keeps its values in another file; such files are not read")
        for i in range(plist.get_nfilters()):
            code = plist.get_filter(i)[0]
            if code not in FILTERS:
                raise InputError(
                    f"'{shown}' is compressed with filter {code}; only gzip, shuffle, fletcher32, szip and lzf are read"
                )
        chunk_rows, chunk_bytes = 0, 0
        if dataset.chunks is not None:
            chunk_rows = int(dataset.chunks[0])
            chunk_bytes = int(np.prod(dataset.chunks, dtype=object)) * dataset.dtype.itemsize
            if chunk_bytes > MAX_CHUNK_BYTES:
                raise InputError(
                    f"'{shown}' is stored in chunks of {chunk_bytes} bytes; at most {MAX_CHUNK_BYTES} are read"
                )
            self.chunks(dataset, plist, shown, chunk_bytes)
        size = int(np.prod(dataset.shape or (0,), dtype=object)) * dataset.dtype.itemsize
        if size > _SMALL and size > _MOST_EXPANSION * max(dataset.id.get_storage_size(), 1):
            raise InputError(
                f"'{shown}' declares {dataset.shape[0]} rows and stores {dataset.id.get_storage_size()} bytes"
            )
        return chunk_rows, chunk_bytes

    def chunks(self, dataset: Any, plist: Any, shown: str, chunk_bytes: int) -> None:
        """Look at every stored chunk. HDF5 itself believes an index that lies about them, and crashes on some lies."""
        filters = [plist.get_filter(i)[0] for i in range(plist.get_nfilters())]
        bad: list[str] = []

        def look(chunk: Any) -> None:
            fits = chunk.byte_offset + chunk.size <= self.size
            # A bit of the mask is a filter that was skipped for this chunk (lzf, where it gains nothing).
            used = [code for i, code in enumerate(filters) if not chunk.filter_mask >> i & 1]
            checksums = 4 * used.count(_FLETCHER32)
            plain = all(code in {_SHUFFLE, _FLETCHER32} for code in used)
            whole = chunk.size == chunk_bytes + checksums if plain else chunk.size > checksums
            # A compressor may give up and store a little more than it was given.
            if not (fits and whole and chunk.size <= 2 * chunk_bytes + 4096):
                bad.append(f"rows from {chunk.chunk_offset[0]} on")

        dataset.id.chunk_iter(look)
        if bad:
            raise InputError(f"'{shown}' is damaged or cut off: its index does not fit the file at {bad[0]}")


class _Audit(Audited):
    """What an HDF5 file holds that could be a log."""

    def __init__(self, path: str) -> None:
        super().__init__(path)
        self.tables: list[dict[str, Any]] = []
        self.arrays: list[dict[str, Any]] = []

    def group(self, group: Any, path: str, depth: int) -> None:
        columns: list[dict[str, Any]] = []
        wide: list[dict[str, Any]] = []
        inner: list[tuple[Any, str]] = []
        for name, here, item in self.members(group, path, depth):
            if isinstance(item, self.h5py.Group):
                inner.append((item, here))
            elif isinstance(item, self.h5py.Dataset):
                self.dataset(item, here, name, columns, wide)
        if columns:
            attributes = self.attributes(group)
            self.tables.append({"path": path, "form": "group", "columns": columns, **attributes})
        if (found := samples.among(wide, path)) is not None:
            self.arrays.append(self.array(group, path, found, columns))
        for item, here in inner:
            self.group(item, here, depth + 1)

    def array(self, group: Any, path: str, found: dict[str, Any], columns: list[dict[str, Any]]) -> dict[str, Any]:
        """Samples with their times and what the group says of the array: its own datasets and attributes."""
        time = next((c for c in columns if c["name"].casefold() in samples.TIMES), None)
        said: dict[str, Any] = {}
        for name in samples.FACTS:
            value = None
            if name in group:
                hard = group.id.links.get_info(name.encode()).type == self.h5py.h5l.TYPE_HARD
                item = group[name] if hard else None
                if isinstance(item, self.h5py.Dataset) and _few_numbers(item):
                    value = item[()]
            elif name in group.attrs and _few_numbers(group.attrs.get_id(name)):
                value = group.attrs[name]
            if value is not None:
                said[name] = np.asarray(value, np.float64).tolist()
        return {
            **found,
            "path": path,
            "time": time["name"] if time else "",
            "time_path": time["path"] if time else "",
            "time_rows": time["rows"] if time else 0,
            "said": said,
            "likely": found["kind"] == "complex" or any(name.startswith("sensor_position") for name in said),
        }

    def dataset(
        self, dataset: Any, path: str, name: str, columns: list[dict[str, Any]], wide: list[dict[str, Any]]
    ) -> None:
        shape, dtype = dataset.shape, dataset.dtype
        chunk_rows, chunk_bytes = self.look(dataset, path)
        if shape is None or not 1 <= len(shape) <= 2:
            return
        rows = int(shape[0])
        # What a reader does to the values can crash too: where they are few, they are all read here first.
        small = 0 < int(np.prod(shape, dtype=object)) * dtype.itemsize <= READ_IN_CHILD
        if small and (dtype.names or dtype.kind == "c" or _kind(dtype, self.h5py) != "other"):
            try:
                dataset[()]
            except (OSError, RuntimeError, ValueError, TypeError) as error:
                raise InputError(
                    f"'{one_line(path, 100)}' cannot be read, the file is damaged or cut off ({one_line(error, 120)})"
                ) from error
        described = {"rows": rows, "chunk_rows": chunk_rows, "chunk_bytes": chunk_bytes, "path": path}
        if len(shape) == 1 and dtype.names:
            fields = [{**described, "name": field, "kind": _kind(dtype[field], self.h5py)} for field in dtype.names]
            self.tables.append({"path": path, "form": "compound", "columns": fields, **self.attributes(dataset)})
        elif len(shape) == 1 or self.is_vector(dataset, name):
            across = len(shape) == 2 and shape[0] == 1
            kind = {"name": name, "kind": _kind(dtype, self.h5py), "shape": list(shape), "across": across}
            if across:
                described |= {"rows": int(shape[1]), "chunk_rows": int(dataset.chunks[1]) if dataset.chunks else 0}
            columns.append({**described, **kind})
        elif dtype.kind == "c" or samples.is_pair(dtype.names):
            wide.append({**described, "name": name, "sensors": int(shape[1]), "kind": "complex"})
        elif dtype.kind in "iuf":
            names = self.names(dataset)
            if len(names) != shape[1]:
                wide.append({**described, "name": name, "sensors": int(shape[1]), "kind": "real"})
                return
            fields = [{**described, "name": n, "kind": "number", "index": i} for i, n in enumerate(names)]
            self.tables.append({"path": path, "form": "matrix", "columns": fields, **self.attributes(dataset)})

    def is_vector(self, dataset: Any, name: str) -> bool:
        """Whether a dataset of two dimensions is a column up or across, as MATLAB's h5write makes of vectors."""
        plain = 1 in dataset.shape and name.casefold() not in samples.NAMES
        return plain and _kind(dataset.dtype, self.h5py) != "other" and not self.names(dataset)

    def attributes(self, item: Any) -> dict[str, Any]:
        return {"stage": self.text(item, "residual_stage"), "kind": None}

    def text(self, item: Any, name: str) -> str | None:
        value = self.value(item, name)
        if isinstance(value, bytes):
            value = value.decode("utf-8", "replace")
        return value if isinstance(value, str) else None

    def names(self, item: Any) -> list[str]:
        value = self.value(item, "columns")
        if value is None:
            return []
        cells = np.atleast_1d(np.asarray(value, dtype=object)).tolist()
        if len(cells) == 1 and isinstance(cells[0], (str, bytes)):
            text = cells[0].decode("utf-8", "replace") if isinstance(cells[0], bytes) else cells[0]
            return text.split(",")
        return [c.decode("utf-8", "replace") if isinstance(c, bytes) else str(c) for c in cells]

    def value(self, item: Any, name: str) -> Any:
        if name not in item.attrs:
            return None
        attribute = item.attrs.get_id(name)
        if int(np.prod(attribute.shape, dtype=object)) > 10_000:
            return None
        if _kind(attribute.dtype, self.h5py) != "text":
            return None
        return item.attrs[name]


def _few_numbers(item: Any) -> bool:
    return item.dtype.kind in "iuf" and int(np.prod(item.shape, dtype=object)) <= 3 * samples.MAX_SENSORS


def _kind(dtype: Any, h5py: Any) -> str:
    if dtype.kind in "iufb" and dtype.shape == () and h5py.check_ref_dtype(dtype) is None:
        return "number"
    if h5py.check_string_dtype(dtype) is not None:
        return "text"
    return "other"
