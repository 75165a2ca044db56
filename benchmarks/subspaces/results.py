"""The files of a comparison: a row each, and what they must have in common."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bridge.errors import DsnetError

SUMMARY = "subspaces.json"


def row_name(code: str, size: int, seed: int) -> str:
    """File of one row."""
    return f"{code}-{size}-{seed}.json"


def rows_in(folder: Path, codes: Sequence[str]) -> list[str]:
    """Names of the finished rows' files: by code, then by size."""
    parts = [(path, path.stem.split("-")) for path in folder.glob("*-*-*.json")]
    known = [(codes.index(part[0]), int(part[1]), path.name) for path, part in parts
             if part[0] in codes]  # fmt: skip
    return [name for _, _, name in sorted(known)]


def read_summary(folder: Path) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """What subspaces.json holds, and the rows that it names."""
    summary = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
    return summary, [
        json.loads((folder / name).read_text(encoding="utf-8")) for name in summary["rows"]
    ]


def refuse_others(folder: Path, settings: Mapping[str, Any]) -> None:
    """Refuse a folder with results of other data or other settings.

    Raises
    ------
    DsnetError
        That names what differs in the first of them.
    """
    for path in sorted([*folder.glob("*-*-*.json"), *folder.glob(SUMMARY)]):
        found = json.loads(path.read_text(encoding="utf-8"))["settings"]
        other = {key: found.get(key) for key in settings if found.get(key) != settings[key]}
        if other:
            raise DsnetError(
                f"{path} with {listed(other)}",
                listed({key: settings[key] for key in other}),
                "Pass another --out, or the same settings.",
            )


def listed(settings: Mapping[str, Any]) -> str:
    """As in "seed 0, steps 345"."""
    return ", ".join(f"{key} {value}" for key, value in settings.items())
