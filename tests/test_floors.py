"""The floors hold: a module imports from its own room or a lower floor, never up, never across."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "rangeeval"

FLOOR = {
    "errors": 0, "units": 0, "compiled": 0, "files": 0, "angles": 0,
    "stats": 1, "physics": 1, "tracking": 1, "arrays": 1,
    "model": 2,
    "parsers": 3, "analyses": 3, "reporting": 3, "archives": 3, "comparison": 3, "requirements": 3, "scenarios": 3,
    "catalog": 3,
    "flow": 4,
    "many": 5,
    "cli": 6,
}  # fmt: skip

# Why each exception stands.
ALLOWED = {
    ("model", "reporting"): "Result.plot() draws itself: users ask a result for its picture",
}

FORBIDDEN = {
    "stats": {"pandas", "matplotlib", "pathlib", "os"},
    "physics": {"pandas", "matplotlib", "pathlib", "os"},
    "tracking": {"pandas", "matplotlib", "pathlib", "os"},
    "arrays": {"pandas", "matplotlib", "pathlib", "os"},
}


def rooms():
    """Every module of the package with its room."""
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        if parts[0] not in {"__init__", "__main__"}:
            yield path, parts[0]


def imports(path):
    """The dotted names a module imports, inside functions too."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


@pytest.mark.parametrize(("path", "room"), list(rooms()), ids=lambda v: v.stem if isinstance(v, Path) else v)
def test_a_module_imports_only_from_its_own_room_or_a_lower_floor(path, room):
    """Data goes one way; nothing above is needed to understand a room."""
    for name in imports(path):
        parts = name.split(".")
        if parts[0] in FORBIDDEN.get(room, ()):
            pytest.fail(f"{path.name} imports {name}: a {room} module takes arrays and gives numbers")
        if parts[0] != "rangeeval" or len(parts) < 2 or parts[1] == "__version__":
            continue
        other = parts[1]
        if other == room or (room, other) in ALLOWED:
            continue
        assert FLOOR[other] < FLOOR[room], f"{path.name} ({room}) imports {name} ({other})"


def test_every_room_has_a_floor():
    """A new room must say where it stands."""
    assert {room for _, room in rooms()} <= set(FLOOR)


def test_analyses_do_not_see_each_other():
    """An analysis imports from its own package only."""
    for path in (PACKAGE / "analyses").rglob("*.py"):
        own = path.relative_to(PACKAGE / "analyses").parts[0].removesuffix(".py")
        for name in imports(path):
            if name.startswith("rangeeval.analyses.") and own != "__init__":
                assert name.split(".")[2] == own, f"{path} imports {name}"
