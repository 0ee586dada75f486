"""The documentation is true: its commands run, its links lead somewhere, its tables are the code's."""

from __future__ import annotations

import dataclasses
import re
import sys
import tomllib
import typing
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

import rangeeval
from rangeeval.cli import cli
from rangeeval.model import TrialSettings, settings_from
from rangeeval.model.result import COLUMNS
from tests import reference_tables
from tests.pages import ROOT, Desk, anchors, blocks, links, matches, pages, steps

REFERENCE = ROOT / "docs" / "reference"
RUNNING = [page for page in pages() if any(not block.installs for block in blocks(page))]


def _name(page: Path) -> str:
    return str(page.relative_to(ROOT))


@pytest.mark.parametrize("page", RUNNING, ids=_name)
def test_every_block_of_a_page_runs(page: Path, tmp_path: Path) -> None:
    """From the top of the page to its end, in one folder with the sample logs; console blocks print what they say."""
    desk = Desk(tmp_path)
    for block in blocks(page):
        at = f"{_name(page)}:{block.line}"
        if block.installs:
            continue
        if block.language == "sh":
            done = desk.shell(block.text)
            assert done.returncode == 0, f"{at}: {done.stderr}"
        elif block.language == "python":
            done = desk.run([sys.executable, "-c", block.text])
            assert done.returncode == 0, f"{at}: {done.stderr}"
        elif block.language == "console":
            for command, output in steps(block.text):
                done = desk.shell(command)
                assert done.returncode in {0, 3}, f"{at}: {done.stderr}"
                assert matches(output, done.stdout), f"{at}: `{command}` printed\n{done.stdout}"
        elif block.language == "toml":
            settings_from(tomllib.loads(block.text), at)
        else:
            assert block.language in {"text", "csv"}, f"{at}: a block of language '{block.language}' is not checked"


@pytest.mark.parametrize("page", pages(), ids=_name)
def test_links_lead_somewhere(page: Path) -> None:
    """A link to another page names a file that is there, and a heading that it has."""
    for written, target, anchor in links(page):
        assert target.exists(), f"{_name(page)}: {written}"
        if anchor:
            assert anchor in anchors(target), f"{_name(page)}: {written}"


def test_every_page_can_be_reached() -> None:
    """Following links from the README leads to every page."""
    seen, todo = set(), [ROOT / "README.md"]
    while todo:
        page = todo.pop()
        if page not in seen and page.suffix == ".md":
            seen.add(page)
            todo += [target for _, target, _ in links(page)]
    assert set(pages()) <= seen


@pytest.mark.parametrize("page", sorted(REFERENCE.glob("*.md")), ids=_name)
def test_tables_made_from_the_code_are_up_to_date(page: Path) -> None:
    """`python -m tests.reference_tables` would change nothing."""
    text = page.read_text(encoding="utf-8")
    assert reference_tables.filled(text) == text


def test_every_kind_of_log_has_its_table() -> None:
    """No literal table is left out of the reference."""
    text = "".join(page.read_text(encoding="utf-8") for page in REFERENCE.glob("*.md"))
    assert set(reference_tables.tables()) == {m["name"] for m in reference_tables.BLOCK.finditer(text)}


def _rows(page: str, heading: str) -> list[list[str]]:
    """The rows of the tables below a heading, cells as text without backquotes."""
    text = (REFERENCE / page).read_text(encoding="utf-8")
    section = re.search(rf"^##+ {heading}$(.*?)(?=^##+ |\Z)", text, re.MULTILINE | re.DOTALL)
    assert section, f"{page} has no heading '{heading}'"
    rows = [
        [cell.strip().replace("`", "") for cell in line.strip("|").split("|")]
        for line in section[1].splitlines()
        if line.startswith("|")
    ]
    return [row for row in rows if row[0] and set(row[0]) != {"-"}][1:]


def _shape(hint: object) -> type:
    return typing.get_args(hint)[0] if typing.get_origin(hint) is tuple else typing.cast(type, hint)


_SHAPES = {name: _shape(hint) for name, hint in typing.get_type_hints(TrialSettings).items()}


def _default(field: dataclasses.Field[object]) -> str:
    if field.default is dataclasses.MISSING:
        return "*required*" if field.default_factory is dataclasses.MISSING else "{}"
    if isinstance(field.default, str):
        return f'"{field.default}"'
    return "none" if field.default is None else repr(field.default)


@pytest.mark.parametrize("table", list(_SHAPES))
def test_settings_are_complete(table: str) -> None:
    """Every key of trial.toml is documented with its default, and no other."""
    written = {row[0]: row[2] for row in _rows("settings.md", table)}
    assert written == {field.name: _default(field) for field in dataclasses.fields(_SHAPES[table])}


def _expanded(rows: list[list[str]]) -> dict[str, str]:
    found = {}
    for name, unit, *_ in (row for row in rows if row[0] != "Quantity"):
        for word, values in (
            ("AXIS", ("range", "y", "z")),
            ("ANGLE", ("elevation", "azimuth")),
            ("ROTATION", ("x", "z")),
        ):
            if word in name:
                found |= {name.replace(word, value): unit for value in values}
                break
        else:
            found[name] = unit
    return found


def test_quantities_are_complete() -> None:
    """Every quantity that accuracy gives on the sample is documented with its unit; the rest needs longer logs."""
    result = rangeeval.accuracy(rangeeval.open_trial(ROOT / "sample_logs" / "inbound"))
    given = {row.quantity: row.unit for row in result.rows}
    written = _expanded(_rows("quantities.md", "accuracy"))
    assert {q: u for q, u in written.items() if not q.endswith("_autocovariance")} == given


def test_quantities_of_attitude_are_complete() -> None:
    """Every quantity that attitude gives on the sample is documented with its unit; a misfit needs three sensors."""
    result = rangeeval.attitude(rangeeval.open_trial(ROOT / "sample_logs" / "attitude"))
    given = {row.quantity: row.unit for row in result.rows}
    written = _expanded(_rows("quantities.md", "attitude"))
    assert {q: u for q, u in written.items() if not q.startswith("height_misfit")} == given


@pytest.mark.parametrize("analysis", ["replay", "truth"])
def test_quantities_of_plots_are_complete(analysis: str) -> None:
    """Every quantity that replay and truth give on the sample is documented with its unit."""
    run = getattr(rangeeval, analysis)
    more = {"compare": True} if analysis == "replay" else {}
    result = run(rangeeval.open_trial(ROOT / "sample_logs" / "attitude"), **more)
    written: dict[str, set[str]] = {}
    for names, unit, *_ in _rows("quantities.md", analysis):
        for name in names.split(", "):
            for word in ("range", "azimuth", "elevation"):
                written[name.replace("COORDINATE", word)] = set(unit.split(", "))
    for row in result.rows:
        assert row.unit in written.get(row.quantity, ()), f"{row.quantity} in {row.unit}"


def test_columns_are_complete() -> None:
    """The columns of a row of estimates, and those that `check` adds."""
    assert tuple(row[0] for row in _rows("results.md", "A row of estimates")) == COLUMNS
    verdicts = rangeeval.check(rangeeval.open_trial(ROOT / "sample_logs" / "inbound")).estimates
    assert {row[0] for row in _rows("quantities.md", "check")} == set(verdicts.columns) - set(COLUMNS)


def commands(group: click.Group, before: str = "") -> Iterator[tuple[str, click.Command]]:
    """Every command by its heading in the reference; those of a group have `group command`."""
    for name in group.list_commands(click.Context(group)):
        command = group.get_command(click.Context(group), name)
        assert command is not None
        if isinstance(command, click.Group):
            yield from commands(command, f"{name} ")
        else:
            yield before + name, command


@pytest.mark.parametrize(("name", "command"), [pytest.param(n, c, id=n) for n, c in commands(cli)])
def test_options_are_complete(name: str, command: click.Command) -> None:
    """Every option of every command is documented, and no other."""
    given = {max(p.opts, key=len) for p in command.params if isinstance(p, click.Option)} - {"--help"}
    if name.startswith("simulate "):  # said once for all scenarios
        given -= {"--output", "--seed"}
    written = {row[0].split(",")[-1].strip() for row in _rows("command-line.md", name)}
    assert written == given
