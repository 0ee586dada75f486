"""What makes two trials the same trial: their logs and settings, whatever the trial and its files are called."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from typing import Any

from rangeeval.model.result import without_nan


def hash_of(value: Any) -> str:
    """A SHA-256 of plain values; the order of keys does not matter."""
    text = json.dumps(without_nan(value), sort_keys=True, ensure_ascii=False, allow_nan=False)
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def trial_hash(settings: Mapping[str, Any], files: Iterable[tuple[str, str]]) -> str:
    """A hash of a trial's settings (as plain values) and of the kind and SHA-256 of each of its files."""
    about = {k: v for k, v in settings.get("trial", {}).items() if k != "name"}
    return hash_of({"settings": {**settings, "trial": about}, "files": sorted(map(list, files))})


def trial_hash_of(provenance: Mapping[str, Any]) -> str:
    """The same of a trial as the provenance of its results tells it; empty when that names no files."""
    try:
        files = [(i["kind"], i["sha256"]) for i in provenance["inputs"]]
        return trial_hash(provenance["settings"], files) if files else ""
    except (KeyError, TypeError, AttributeError):
        return ""
