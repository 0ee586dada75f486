"""Strings that break careless reports, and a document with one of them in every text field."""

from __future__ import annotations

import datetime

from rangeeval.reporting.blocks import Cell, Document, Figure, Mark, Notice, Panel, Paragraph, Section, Table

STRINGS = (
    "<script>document.documentElement.dataset.pwned = 1</script>",
    "</script><script>document.documentElement.dataset.pwned = 1</script>",
    '"><img src=x onerror="document.documentElement.dataset.pwned = 1">',
    "<svg onload=alert(1)><style>*{display:none}</style>",
    "<b>bold</b> &amp; &#60;i&#62; {{ 7 * 7 }} {% raw %} ${7*7}",
    "javascript:alert(1)",
    r"a $\foo$ b_{c",
    r"$$\text{\href{javascript:alert(1)}{x}}$$ \[ x \] \( y \)",
    "_name",
    "",
    "   ",
    '#import "/etc/passwd" as x #read("data.json") #{panic("x")} *a* _b_ `c` @d <e> $f$ = g',
    "]]> <!-- --> <![CDATA[ x ]]> <?xml?>",
    "@x{safe} $index @{y}{custom} $~",
    "control \x00 \x07 \x1b[31m \x7f \x9b end",
    "line\nbreak\ttab\r\nreturn\u2028separator\u2029",
    "bidi \u202e evil \u202c \u2066 isolate \u2069 \u200f mark",
    "surrogates \ud800 and \udfff",
    "private \ue000 \U000f0000 and noncharacter \uffff \ufdd0",
    "기만 시험 3차 (진입)",
    "한글 jamo: \u1112\u1161\u11ab",
    "emoji 🛰️ 👩‍🚀 😀 🇰🇷",
    "日本語 中文 العربية עברית ไทย हिन्दी",
    "e\u0301 combining z" + "\u0310" * 60,
    "x" * 500,
    "가" * 500,
    "word-" * 100,
    "zero\u200bwidth\u00a0space \ufeff",
    "../../etc/passwd C:\\con %s %n {0}",
)


def hostile_document(text: str) -> Document:
    """The same text wherever a text can stand."""
    marks = (
        Mark("points", (1.0, 2.0), (1.0, 3.0), label=text, role=text),
        Mark("line", (1.0, 2.0), (1.0, 3.0), label=text + "'", role="group2"),
    )
    panel = Panel(text, text, text, marks, share_x=text)
    return Document(
        text,
        datetime.datetime(2026, 1, 2, tzinfo=datetime.UTC),
        subtitle=text,
        handling=text,
        meta=((text, text),),
        sections=(
            Section(
                text,
                (
                    Paragraph(text),
                    *(Notice(text, level, text) for level in ("info", "good", "caution", "bad")),
                    Table(
                        text,
                        (text, text),
                        ((text, Cell(text, "fail", strong=True)), (Cell(text, "pass"), text)),
                    ),
                    Figure(text, text, ((panel, None), (panel,))),
                ),
                own_page=True,
                level=3,
                key=text,
            ),
            Section(text, (), level=2, key=text),
        ),
    )
