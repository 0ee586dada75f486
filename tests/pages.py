"""The pages of the documentation: their command blocks, run as a reader would, and their links.

    ```sh         run with bash; the marker `<!-- installs -->` on the line above leaves it to .ci/run
    ```console    lines that begin with `$ ` are run, the lines below are what they print (`...` stands for anything)
    ```python     run as a script
    ```toml       read as a trial.toml

`python -m tests.pages` runs every console block and writes what it prints into the page, where that is not what the page
says. A block that was shortened with `...` comes back whole then: shorten it again.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
INSTALLS = "<!-- installs -->"
FENCE = re.compile(r"^```([a-z]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"(?<!`)\[[^\]]*\]\(([^)\s]+)\)")


@dataclass(frozen=True)
class Block:
    """A fenced block of a page: its language, its text, its line, and whether it installs something."""

    language: str
    text: str
    line: int
    installs: bool


def pages() -> list[Path]:
    """Every page whose blocks are run."""
    front = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")]
    return [*front, *sorted((ROOT / "docs").rglob("*.md"))]


def blocks(page: Path) -> Iterator[Block]:
    """The fenced blocks of a page in order."""
    text = page.read_text(encoding="utf-8")
    for found in FENCE.finditer(text):
        before = text[: found.start()].rstrip().rsplit("\n", 1)[-1]
        yield Block(found[1], found[2], text.count("\n", 0, found.start()) + 1, before == INSTALLS)


def steps(text: str) -> Iterator[tuple[str, str]]:
    """The commands of a console block, each with the output written below it."""
    command, output = "", ""
    for line in text.splitlines():
        if line.startswith("$ "):
            if command:
                yield command, output
            command, output = line[2:], ""
        elif not output and command.endswith("\\"):
            command += f"\n{line}"
        else:
            output += f"{line}\n"
    if command:
        yield command, output


def matches(wanted: str, got: str) -> bool:
    """Whether output is as written; `...` stands for anything, and any run of blanks is one (columns may move)."""
    parts = [re.escape(_spaced(part)) for part in _trimmed(wanted).split("...")]
    return re.fullmatch(".*".join(parts), _spaced(_trimmed(got)), re.DOTALL) is not None


def _spaced(text: str) -> str:
    return re.sub(" +", " ", text)


def _trimmed(text: str) -> str:
    return "\n".join(line.rstrip() for line in text.strip().splitlines())


class Desk:
    """A folder with a copy of the samples, where `rangeeval` and `python` are this checkout's."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / "work"
        self.folder.mkdir()
        import shutil

        shutil.copytree(ROOT / "sample_logs", self.folder / "sample_logs")
        tools = folder / "tools"
        tools.mkdir()
        for name, words in {"rangeeval": f"'{sys.executable}' -m rangeeval", "python": f"'{sys.executable}'"}.items():
            script = tools / name
            script.write_text(f'#!/bin/sh\nexec {words} "$@"\n', encoding="utf-8")
            script.chmod(0o755)
        path = os.pathsep.join([str(tools), os.environ.get("PATH", os.defpath)])
        self.environment = {
            **{k: v for k, v in os.environ.items() if not k.startswith("COV_")},
            "PATH": path,
            "PYTHONPATH": str(ROOT),
            "COLUMNS": "200",
            "MPLBACKEND": "Agg",
        }

    def run(self, words: list[str]) -> subprocess.CompletedProcess[str]:
        """Run a program here."""
        return subprocess.run(
            words, cwd=self.folder, env=self.environment, capture_output=True, text=True, timeout=120, check=False
        )

    def shell(self, text: str) -> subprocess.CompletedProcess[str]:
        """Run shell commands here; the first that fails ends them."""
        return self.run(["bash", "-euo", "pipefail", "-c", text])


def links(page: Path) -> Iterator[tuple[str, Path, str]]:
    """The links of a page to files beside it: as written, the file meant, and the heading meant."""
    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    for found in LINK.finditer(text):
        target = found[1]
        if re.match(r"[a-z]+:", target):
            continue
        name, _, anchor = target.partition("#")
        yield target, (page.parent / name).resolve() if name else page, anchor


def anchors(page: Path) -> set[str]:
    """The anchors of a page's headings, as forges make them."""
    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    found = set()
    for heading in re.findall(r"^#+ +(.+)$", text, re.MULTILINE):
        words = re.sub(r"[^\w\- ]", "", heading.strip().lower())
        found.add(words.replace(" ", "-"))
    return found


def rewrite(page: Path) -> None:
    """Write into a page what its console blocks print, where it differs from what it says."""
    text = page.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as scratch:
        desk = Desk(Path(scratch))
        for block in blocks(page):
            if block.language in {"sh", "python"} and not block.installs:
                desk.shell(block.text) if block.language == "sh" else desk.run([sys.executable, "-c", block.text])
            if block.language != "console":
                continue
            made = ""
            for command, output in steps(block.text):
                got = desk.shell(command).stdout
                made += f"$ {command}\n" + (output if matches(output, got) else f"{_trimmed(got)}\n")
            text = text.replace(f"```console\n{block.text}```", f"```console\n{made}```")
    page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    for one in pages():
        if any(block.language == "console" for block in blocks(one)):
            rewrite(one)
