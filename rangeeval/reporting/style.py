"""How things look, once for every renderer: colours by meaning, sizes, typefaces.

Colours follow Okabe and Ito (2008), "Color Universal Design", which readers with any common kind of colour
vision can tell apart; line patterns and marker shapes say the same again for print without colour.
"""

from __future__ import annotations

from dataclasses import dataclass

TEXT_WIDTH_PT = 487.0  # A4 less margins of 19 mm
ROW_HEIGHT_PT = {"compact": 96.0, "normal": 172.0, "tall": 255.0}
ROW_HEIGHT_PX = {"compact": 210, "normal": 300, "tall": 430}
FONT_FAMILIES = ("DejaVu Sans", "NanumGothic")

INK = "#1b2733"
MUTED = "#55626f"
GRID = "#e3e8ed"
FRAME = "#9aa7b3"


HEAT = ("#FFFFFF", "#E3E8ED", "#C3CCD4", "#9DA9B5", "#76838F")  # from low to high: greys, under coloured lines
HEAT_LEVELS = 64


def heat_colours() -> list[str]:
    """`HEAT_LEVELS` colours from the lowest value to the highest, evenly between those of `HEAT`."""
    stops = [[int(colour[i : i + 2], 16) for i in (1, 3, 5)] for colour in HEAT]
    found = []
    for level in range(HEAT_LEVELS):
        at = level * (len(stops) - 1) / (HEAT_LEVELS - 1)
        i = min(int(at), len(stops) - 2)
        parts = (round(a + (at - i) * (b - a)) for a, b in zip(stops[i], stops[i + 1], strict=True))
        found.append("#" + "".join(f"{part:02X}" for part in parts))
    return found


@dataclass(frozen=True)
class Look:
    """How one role is drawn: a colour, a dash pattern in points (empty: solid) and a marker shape."""

    colour: str
    dash: tuple[float, ...] = ()
    marker: str = "circle"
    width: float = 1.1


_LOOKS = {
    "measured": Look("#0072B2"),
    "predicted": Look("#D55E00", (5.0, 2.5), "square"),
    "reference": Look("#5B6875", (), "triangle", 0.9),
    "limit": Look("#9B2C6F", (6.0, 2.0, 1.2, 2.0), "diamond"),
    "grid": Look(GRID, (), "circle", 0.6),
    "none": Look("#7A6A00", (6.0, 2.0), "triangle", 1.0),
    "single": Look("#D55E00", (), "square", 0.7),
    "pair": Look("#0072B2", (), "circle", 1.2),
    "group1": Look("#0072B2"),
    "group2": Look("#C77700", (5.0, 2.0), "square"),
    "group3": Look("#00805E", (2.0, 1.6), "triangle"),
    "group4": Look("#B8508C", (6.0, 2.0, 1.2, 2.0), "diamond"),
    "group5": Look("#3A9BD6", (8.0, 2.0), "circle"),
    "group6": Look("#D55E00", (3.0, 1.5, 1.0, 1.5), "square"),
    "group7": Look("#7A6A00", (1.2, 1.4), "triangle"),
    "group8": Look("#1b2733", (9.0, 3.0), "diamond"),
}

ROLES = tuple(_LOOKS)


def look(role: str) -> Look:
    """The look of a role; groups beyond the eighth start over, and an unknown role looks like `reference`."""
    if role in _LOOKS:
        return _LOOKS[role]
    number = role.removeprefix("group")
    if role.startswith("group") and number.isdecimal():
        return _LOOKS[f"group{(int(number) - 1) % 8 + 1}"]
    return _LOOKS["reference"]
