"""UDP payloads of network captures: pcap and pcapng, Ethernet (with VLAN tags), Linux cooked or raw IP, IPv4 and IPv6.

Fragments and packets that the capture cut short are counted and left out: half a message is no message.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import IO

from rangeeval.parsers.asterix.framing import Note

_CLASSIC = {
    b"\xa1\xb2\xc3\xd4": ">", b"\xd4\xc3\xb2\xa1": "<",  # microseconds
    b"\xa1\xb2\x3c\x4d": ">", b"\x4d\x3c\xb2\xa1": "<",  # nanoseconds
}  # fmt: skip
_SECTION = b"\x0a\x0d\x0d\x0a"
_BYTE_ORDER = {b"\x1a\x2b\x3c\x4d": ">", b"\x4d\x3c\x2b\x1a": "<"}
_LARGEST_PACKET = 1 << 18  # libpcap's own limit
_INTERFACE, _PACKET, _SIMPLE_PACKET, _ENHANCED_PACKET = 1, 2, 3, 6
_MAX_INTERFACES = 1024

# Link types (the number in the file): where the protocol's number stands, and where the packet begins.
_ETHERNET, _RAW = {1: (12, 14)}, {12, 14, 101, 228, 229}
_COOKED = {113: (14, 16), 276: (0, 20)}
_NULL = {0, 108}
_VLAN = {0x8100, 0x88A8, 0x9100}
_IPV4, _IPV6, _UDP = 0x0800, 0x86DD, 17
_IPV6_EXTENSIONS = {0, 43, 60}  # hop by hop, routing, destination options
_IPV6_FRAGMENT = 44

CUT_OFF = "a packet that is cut off at the end of the capture"
LOST = "damage from which on the capture cannot be followed"
SHORT = "packets that the capture cut short"
FRAGMENT = "fragments of packets, which are not put together"
OTHER_LINK = "packets of a link that is neither Ethernet, Linux cooked nor raw IP"
BROKEN = "packets whose lengths contradict each other"

Payload = tuple[int, bytes]  # where it lies in the file, and its bytes


def is_capture(head: bytes) -> bool:
    """The signature of pcap in either byte order and resolution, or of pcapng."""
    return head[:4] in _CLASSIC or (
        head.startswith(_SECTION) and head[8:12] in (b"\x1a\x2b\x3c\x4d", b"\x4d\x3c\x2b\x1a")
    )


def payloads(stream: IO[bytes], note: Note) -> Iterator[Payload]:
    """The UDP payloads of a capture in its order, up to where its packets cannot be followed any more."""
    head = stream.read(4)
    packets = _classic(stream, _CLASSIC[head], note) if head in _CLASSIC else _blocks(stream, note)
    for at, link, packet in packets:
        found = _udp(packet, link)
        if isinstance(found, str):
            if found:
                note(found, at, len(packet))
        elif found[0] < found[1]:
            yield at + found[0], packet[found[0] : found[1]]


def _classic(stream: IO[bytes], order: str, note: Note) -> Iterator[tuple[int, int, bytes]]:
    """Place, link type and bytes of every whole packet of a classic capture."""
    head = stream.read(20)
    if len(head) < 20:
        note(CUT_OFF, 4, len(head))
        return
    link = struct.unpack_from(f"{order}I", head, 16)[0] & 0xFFFF
    at = 24
    while len(head := stream.read(16)) == 16:
        kept, length = struct.unpack_from(f"{order}II", head, 8)
        at += 16
        if kept > _LARGEST_PACKET:
            note(LOST, at - 16, 16)
            return
        packet = stream.read(kept)
        if len(packet) < kept:
            note(CUT_OFF, at, len(packet))
            return
        if kept < length:
            note(SHORT, at, kept)
        else:
            yield at, link, packet
        at += kept
    if head:
        note(CUT_OFF, at, len(head))


def _blocks(stream: IO[bytes], note: Note) -> Iterator[tuple[int, int, bytes]]:
    """Place, link type and bytes of every whole packet of a pcapng capture."""
    at, order = 0, "<"
    links: list[tuple[int, int]] = []
    kind_bytes = _SECTION
    while len(kind_bytes) == 4:
        rest = stream.read(4)
        if kind_bytes == _SECTION:
            order, links, have = _BYTE_ORDER.get(stream.read(4), "<"), [], 12
        else:
            have = 8
        if len(rest) < 4:
            note(CUT_OFF, at, len(rest))
            return
        kind, size = struct.unpack(f"{order}II", kind_bytes + rest)
        if size < have + 4 or size % 4 or size > 2 * _LARGEST_PACKET + (1 << 16):
            note(LOST, at, 8)
            return
        body = stream.read(size - have)
        if len(body) < size - have:
            note(CUT_OFF, at, len(body))
            return
        body = body[:-4]
        if kind == _INTERFACE and len(body) >= 8 and len(links) < _MAX_INTERFACES:
            link, _, snap = struct.unpack_from(f"{order}HHI", body)
            links.append((link, snap or _LARGEST_PACKET))
        elif kind in (_ENHANCED_PACKET, _PACKET, _SIMPLE_PACKET):
            found = _packet(kind, body, order, links)
            if isinstance(found, str):
                note(found, at, len(body))
            else:
                begin, link, packet = found
                yield at + have + begin, link, packet
        at += size
        kind_bytes = stream.read(4)
    if kind_bytes:
        note(CUT_OFF, at, len(kind_bytes))


def _packet(kind: int, body: bytes, order: str, links: list[tuple[int, int]]) -> tuple[int, int, bytes] | str:
    """The packet of a block of a pcapng capture: where in the block, its link type and bytes; or why there is none."""
    if len(body) < (4 if kind == _SIMPLE_PACKET else 20):
        return BROKEN
    if kind == _SIMPLE_PACKET:
        interface, begin = 0, 4
        (length,) = struct.unpack_from(f"{order}I", body)
        kept = min(length, links[0][1]) if links else length
    else:
        begin = 20
        interface = struct.unpack_from(f"{order}{'I' if kind == _ENHANCED_PACKET else 'H'}", body)[0]
        kept, length = struct.unpack_from(f"{order}II", body, 12)
    if interface >= len(links) or begin + kept > len(body):
        return BROKEN
    return (begin, links[interface][0], body[begin : begin + kept]) if kept == length else SHORT


def _udp(packet: bytes, link: int) -> tuple[int, int] | str:
    """Where the UDP payload of a packet begins and ends; or why there is none ('' for what is no UDP)."""
    try:
        at = _network(packet, link)
        if isinstance(at, str):
            return at
        version = packet[at] >> 4
        inside = _in_ipv4(packet, at) if version == 4 else _in_ipv6(packet, at) if version == 6 else ""
        if isinstance(inside, str):
            return inside
        begin, end = inside
        (length,) = struct.unpack_from(">H", packet, begin + 4)
    except (IndexError, struct.error):
        return BROKEN
    # Behind the datagram a frame may be padded to the least length of Ethernet.
    return (begin + 8, begin + length) if 8 <= length <= end - begin else BROKEN


def _network(packet: bytes, link: int) -> int | str:
    """Where the IP packet begins; '' for another protocol."""
    if link in _RAW:
        return 0
    if link in _NULL:
        return 4
    placed = _ETHERNET.get(link) or _COOKED.get(link)
    if placed is None:
        return OTHER_LINK
    where, begin = placed
    (protocol,) = struct.unpack_from(">H", packet, where)
    while protocol in _VLAN:
        (protocol,) = struct.unpack_from(">H", packet, begin + 2)
        begin += 4
    return begin if protocol in (_IPV4, _IPV6) else ""


def _in_ipv4(packet: bytes, at: int) -> tuple[int, int] | str:
    header = 4 * (packet[at] & 15)
    total, _, fragment = struct.unpack_from(">HHH", packet, at + 2)
    if packet[at + 9] != _UDP:
        return ""
    if fragment & 0x3FFF:  # more to come, or not the first
        return FRAGMENT
    return (at + header, at + total) if header >= 20 and header <= total <= len(packet) - at else BROKEN


def _in_ipv6(packet: bytes, at: int) -> tuple[int, int] | str:
    (length,) = struct.unpack_from(">H", packet, at + 4)
    following, begin, end = packet[at + 6], at + 40, at + 40 + length
    while following in _IPV6_EXTENSIONS:
        following, begin = packet[begin], begin + 8 * (packet[begin + 1] + 1)
    if following == _IPV6_FRAGMENT:
        return FRAGMENT
    if following != _UDP:
        return ""
    return (begin, end) if end <= len(packet) else BROKEN
