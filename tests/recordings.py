"""ASTERIX recordings byte by byte, from the category documents alone, and the sample trial made of them.

`python -m tests.recordings FOLDER` writes the sample again.
"""

from __future__ import annotations

import struct
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from rangeeval.physics.geodesy import north_up_east

# The order of the items in the field specification of each category (the user application profiles of CAT010 1.1,
# CAT021 2.1 and 0.23, CAT034 1.27, CAT048 1.27 and CAT062 1.18); only those that are written here.
PROFILES: dict[str, dict[str, int]] = {
    "010": {"010": 1, "000": 2, "020": 3, "140": 4, "041": 5, "040": 6, "042": 7, "161": 10, "170": 11, "060": 12,
            "220": 13, "090": 17, "091": 18},
    "021": {"010": 1, "040": 2, "161": 3, "071": 5, "130": 6, "131": 7, "080": 11, "073": 12, "140": 16, "090": 17,
            "145": 21, "077": 28, "170": 29, "132": 38},
    "021-0.23": {"010": 1, "040": 2, "030": 3, "130": 4, "080": 5, "140": 6, "090": 7, "210": 8, "145": 10},
    "034": {"010": 1, "000": 2, "030": 3, "020": 4},
    "048": {"010": 1, "140": 2, "020": 3, "040": 4, "070": 5, "090": 6, "130": 7, "220": 8, "240": 9, "250": 10,
            "161": 11, "042": 12, "200": 13, "170": 14, "030": 16},
    "062": {"010": 1, "070": 4, "105": 5, "100": 6, "185": 7, "380": 11, "040": 12, "080": 13, "136": 17, "130": 18,
            "135": 19},
}  # fmt: skip

Items = Mapping[str, bytes]


def record(profile: str, items: Items) -> bytes:
    """A record: its field specification, then its items in their order."""
    places = {PROFILES[profile][name]: data for name, data in items.items()}
    spec = bytearray((max(places) + 6) // 7)
    for place in places:
        spec[(place - 1) // 7] |= 0x80 >> (place - 1) % 7
    for i in range(len(spec) - 1):
        spec[i] |= 1
    return bytes(spec) + b"".join(places[place] for place in sorted(places))


def block(category: int, *records: bytes) -> bytes:
    """A data block: category, length, records."""
    body = b"".join(records)
    return struct.pack(">BH", category, 3 + len(body)) + body


def time(seconds: float) -> bytes:
    """Time of day in 1/128 s."""
    return round(seconds % 86400 * 128).to_bytes(3, "big")


def level_dbm(value: int) -> bytes:
    """I048/130 with the amplitude of the reply (SAM) alone."""
    return b"\x20" + struct.pack(">b", value)


def plot(
    seconds: float, nmi: float, degrees: float, *, sensor: tuple[int, int] = (25, 11), address: int | None = None,
    track: int | None = None, code: int | None = None, dbm: int | None = None, descriptor: bytes = b"\xa0",
    **more: bytes,
) -> bytes:  # fmt: skip
    """A CAT048 record; `descriptor` is I048/020 (Mode S roll-call by default)."""
    items: dict[str, bytes] = {
        "010": bytes(sensor),
        "140": time(seconds),
        "020": descriptor,
        "040": struct.pack(">HH", round(nmi * 256), round(degrees * 65536 / 360) % 65536),
    }
    if code is not None:
        items["070"] = struct.pack(">H", code)
    if dbm is not None:
        items["130"] = level_dbm(dbm)
    if address is not None:
        items["220"] = address.to_bytes(3, "big")
    if track is not None:
        items["161"] = struct.pack(">H", track)
    return record("048", items | {f"{name[1:]}": data for name, data in more.items()})


def position(
    seconds: float, latitude: float, longitude: float, *, address: int, sensor: tuple[int, int] = (25, 99),
    feet: float | None = None, level: float | None = None, descriptor: bytes = b"\x00",
) -> bytes:  # fmt: skip
    """A CAT021 record of edition 2.1 with I021/131 and the time of reception."""
    items: dict[str, bytes] = {
        "010": bytes(sensor),
        "040": descriptor,
        "131": struct.pack(">ii", round(latitude * 2**30 / 180), round(longitude * 2**30 / 180)),
        "080": address.to_bytes(3, "big"),
        "073": time(seconds),
        "090": b"\x00",
    }
    if feet is not None:
        items["140"] = struct.pack(">h", round(feet / 6.25))
    if level is not None:
        items["145"] = struct.pack(">h", round(level * 4))
    return record("021", items)


def north_mark(seconds: float, sensor: tuple[int, int] = (25, 11)) -> bytes:
    """A CAT034 block: the antenna passes north."""
    return block(34, record("034", {"010": bytes(sensor), "000": b"\x01", "030": time(seconds)}))


def one_of_each() -> list[bytes]:
    """Blocks of every category that gives a log, of two radars and with service messages among them."""
    surface = {"010": b"\x00\x07", "000": b"\x01", "020": b"\x61\x01\x02", "161": b"\x00\x2a", "170": b"\x01\x00"}
    track = {
        "010": b"\x19\x01", "070": time(60), "105": struct.pack(">ii", 2**23, -(2**22)), "040": b"\x00\x2a",
        "080": b"\x01\x01\x01\x00", "130": b"\0\x10", "380": b"\xc1\x01\x02\x71\xc0\x01" + bytes(7),
    }  # fmt: skip
    return [
        block(48, plot(60, 10, 20, address=0x3C660C, track=7, dbm=-60), plot(61, 11, 21, track=8, code=0o7001)),
        north_mark(62),
        block(48, plot(62, 10, 20, sensor=(25, 12), address=0x3C660C, _250=b"\x02" + bytes(16), _030=b"\x03\x02")),
        block(10, record("010", surface | {"140": time(60), "040": struct.pack(">HH", 1234, 16384)})),
        block(10, record("010", surface | {"140": time(61), "042": struct.pack(">hh", -300, 400)})),
        block(21, position(60, 36.5, 127.25, address=0x71C001, feet=10000, descriptor=b"\x01\x00")),
        block(62, record("062", track), record("062", track)),
    ]


# --- captures --------------------------------------------------------------------------------------------------------


def datagram(payload: bytes, *, source: bytes = b"\x0a\x00\x00\x01", fragment: int = 0) -> bytes:
    """An IPv4 packet with a UDP datagram."""
    udp = struct.pack(">HHHH", 21000, 8600, 8 + len(payload), 0) + payload
    return (
        struct.pack(">BBHHHBBH4s4s", 0x45, 0, 20 + len(udp), 1, fragment, 16, 17, 0, source, b"\xe8\x01\x02\x03") + udp
    )


def datagram6(payload: bytes, *, hops: bool = False) -> bytes:
    """An IPv6 packet with a UDP datagram, perhaps behind a hop-by-hop header."""
    udp = struct.pack(">HHHH", 21000, 8600, 8 + len(payload), 0) + payload
    more = b"\x11\x00\x05\x02\x00\x00\x00\x00" if hops else b""
    return struct.pack(">IHBB", 6 << 28, len(more) + len(udp), 0 if hops else 17, 16) + bytes(32) + more + udp


def ethernet(packet: bytes, vlan: Sequence[int] = ()) -> bytes:
    """An Ethernet frame, padded to its least length; `vlan`: the tags around the packet."""
    kind = 0x86DD if packet[0] >> 4 == 6 else 0x0800
    tags = b"".join(struct.pack(">HH", 0x88A8 if i == 0 and len(vlan) > 1 else 0x8100, t) for i, t in enumerate(vlan))
    return (bytes(12) + tags + struct.pack(">H", kind) + packet).ljust(60, b"\0")


def pcap(frames: Iterable[bytes], *, link: int = 1, order: str = "<", nanoseconds: bool = False) -> bytes:
    """A classic capture."""
    magic = 0xA1B23C4D if nanoseconds else 0xA1B2C3D4
    head = struct.pack(f"{order}IHHiIII", magic, 2, 4, 0, 0, 65535, link)
    return head + b"".join(struct.pack(f"{order}IIII", 0, 0, len(f), len(f)) + f for f in frames)


def pcapng(frames: Iterable[bytes], *, link: int = 1, order: str = "<", simple: bool = False) -> bytes:
    """A pcapng capture with one interface."""

    def part(kind: int, body: bytes) -> bytes:
        body += bytes(-len(body) % 4)
        size = struct.pack(f"{order}I", 12 + len(body))
        return struct.pack(f"{order}I", kind) + size + body + size

    made = part(0x0A0D0D0A, struct.pack(f"{order}IHHq", 0x1A2B3C4D, 1, 0, -1))
    made += part(1, struct.pack(f"{order}HHI", link, 0, 65535))
    for f in frames:
        if simple:
            made += part(3, struct.pack(f"{order}I", len(f)) + f)
        else:
            made += part(6, struct.pack(f"{order}IIIII", 0, 0, 0, len(f), len(f)) + f)
    return made


# --- the sample ------------------------------------------------------------------------------------------------------

TRIAL_TOML = """\
# A simulated radar recorded from two networks, and what aircraft report of themselves (ADS-B). Truth: range bias 60 m,
# range sigma 30 m, azimuth bias 0.10 deg, azimuth sigma 0.06 deg. The recording crosses midnight.
[trial]
name = "Simulated monopulse radar, ASTERIX"
date = 2026-05-14
radar = "Simulated monopulse secondary radar"
handling = "UNCLASSIFIED - SIMULATED DATA"

[site]
latitude_deg = 36.42
longitude_deg = 127.39
height_m = 110.0

[bins]
variable = "range"
width = 20000.0
start = 0.0
min_samples = 10
"""

SITE = (np.radians(36.42), np.radians(127.39), 110.0)
BIAS_M, SIGMA_M, BIAS_DEG, SIGMA_DEG = 60.0, 30.0, 0.10, 0.06
START_S, LAST_S, TURN_S = 86400.0 - 240.0, 400.0, 4.0

# Address, latitude, longitude and height (m) at the start, and what they change by in a second.
FLIGHTS = (
    (0x71C001, 36.60, 127.00, 9000.0, -0.0002, 0.0022, 0.0),
    (0x71C002, 36.10, 127.90, 4000.0, 0.0016, -0.0011, 6.0),
    (0x71C003, 36.95, 127.80, 10500.0, -0.0021, -0.0002, -2.0),
)


def write(folder: Path) -> None:
    """Write the sample trial: `radar.pcap` (CAT034, CAT048), `adsb.ast` (CAT021, edition 2.1) and `trial.toml`."""
    rng = np.random.default_rng(1)
    frames: list[tuple[float, bytes]] = []
    reports: list[tuple[float, bytes]] = []
    for turn in np.arange(0.0, LAST_S, TURN_S):
        frames.append((turn, north_mark(START_S + turn)))
        for number, flight in enumerate(FLIGHTS):
            at = turn + 0.5 + number
            distance, azimuth = _seen(flight, at)
            distance += BIAS_M + SIGMA_M * rng.standard_normal()
            azimuth += BIAS_DEG + SIGMA_DEG * rng.standard_normal()
            level = round(-60 - 20 * np.log10(distance / 50e3) + 2 * rng.standard_normal())
            made = plot(START_S + at, distance / 1852, azimuth, address=flight[0], track=100 + number, dbm=level)
            frames.append((at, block(48, made)))
    for second in np.arange(-2.0, LAST_S + 2):
        for number, flight in enumerate(FLIGHTS):
            at = second + 0.25 * number
            latitude, longitude, height = _where(flight, at)
            made = position(START_S + at, latitude, longitude, address=flight[0], feet=height / 0.3048)
            reports.append((at, block(21, made)))
    folder.mkdir(parents=True, exist_ok=True)
    packets = [
        ethernet(datagram(data, source=bytes([10, 0, network, 1])), vlan=[100 + network])
        for number, (_, data) in enumerate(sorted(frames))
        for network in ((1, 2) if number % 5 == 0 else (1,))  # some of it came over both networks
    ]
    (folder / "radar.pcap").write_bytes(pcap(packets))
    (folder / "adsb.ast").write_bytes(b"".join(data for _, data in sorted(reports)))
    (folder / "trial.toml").write_text(TRIAL_TOML, encoding="utf-8")


def _where(flight: Sequence[float], at: float) -> tuple[float, float, float]:
    """Latitude and longitude (deg) and height (m) of a flight at a time."""
    _, latitude, longitude, height, north, east, up = flight
    return latitude + north * at, longitude + east * at, height + up * at


def _seen(flight: Sequence[float], at: float) -> tuple[float, float]:
    """True slant range (m) and azimuth (deg) of a flight at a time."""
    latitude, longitude, height = _where(flight, at)
    north, up, east = north_up_east(np.radians(latitude), np.radians(longitude), height, SITE)
    return float(np.sqrt(north**2 + up**2 + east**2)), float(np.degrees(np.arctan2(east, north)) % 360)


if __name__ == "__main__":
    write(Path(sys.argv[1]))
