"""The tables of docs/reference that repeat a literal table of the code, made from it.

`python -m tests.reference_tables` writes them again, each between its pair of markers; a test holds them to the code.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from rangeeval.model import KINDS
from rangeeval.parsers import FORMATS
from rangeeval.reporting.wording import FLAGS
from rangeeval.units import UNITS, spellings

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "reference"
BLOCK = re.compile(r"(<!-- table: (?P<name>[^>]+?) -->\n).*?(<!-- end of table -->)", re.DOTALL)

_UNIT_WORDS = {"m_s2": "m/s²", "db": "dB", "dbm": "dBm", "per_m2": "1/m²", "m_s": "m/s", "hz": "Hz", "1": "pure number"}


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    head = list(head)
    lines = [head, ["---"] * len(head), *(list(row) for row in rows)]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines) + "\n"


def _columns(kind: str) -> str:
    rows = []
    for column in KINDS[kind].columns:
        unit = "text" if column.text else _UNIT_WORDS.get(column.unit, column.unit)
        unit = "numbers, one a sensor" if column.wide else unit
        others = (
            [] if column.text or column.wide else [s for s in spellings(column.name, column.unit) if s != column.name]
        )
        endings = ", ".join(f"`{name}`" for name in others[:3]) + (", ..." if len(others) > 3 else "")
        rows.append([f"`{column.name}`", unit, "yes" if column.required else "", column.about, endings])
    return _table(["Column", "Unit", "Required", "What it is", "Also written"], rows)


def _units() -> str:
    rows = []
    for stored, units in UNITS.items():
        endings = [f"`_{u.ending}`" if u.ending else "no ending" for u in units]
        rows.append([_UNIT_WORDS.get(stored, stored), ", ".join(endings)])
    return _table(["Stored as", "A column's name may end in"], rows)


def tables() -> dict[str, str]:
    """Every table that is made, by name."""
    made = {f"columns of {kind}": _columns(kind) for kind in KINDS}
    made["kinds"] = _table(
        ["Kind", "One row is", "At least one of"],
        [[f"`{k.name}`", k.row, ", ".join(f"`{n}`" for n in k.any_of)] for k in KINDS.values()],
    )
    made["units"] = _units()
    made["flags"] = _table(["Flag", "Meaning"], [[f"`{flag}`", meaning] for flag, meaning in FLAGS.items()])
    made["formats"] = _table(["Format"], [[f"`{name}`"] for name in FORMATS])
    return made


def filled(text: str) -> str:
    """A page with the tables between its markers made anew (KeyError for a name that is none)."""
    made = tables()
    return BLOCK.sub(lambda m: f"{m[1]}\n{made[m['name']]}\n{m[3]}", text)


def main() -> None:
    """Write the tables of every page."""
    for page in sorted(FOLDER.glob("*.md")):
        page.write_text(filled(page.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
