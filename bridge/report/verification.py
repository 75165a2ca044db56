"""What the report says about `dsnet verify`."""

from __future__ import annotations

import json
from typing import Any

from bridge.report.measured import Stages
from bridge.runs import Artifact

_FORWARD = ("layers", "loss", "losses")
_PACKAGES = {"torch": "torch", "keras": "keras", "onnx": "onnxruntime", "stream": "numpy"}


def read_parity(verify: Artifact) -> dict[str, Any]:
    """The contents of `parity.json`."""
    return json.loads(verify.file("parity.json").read_text(encoding="utf-8"))


def verification(stages: Stages) -> dict[str, Any] | None:
    """Rows, those that hold, and the largest differences of each engine and precision."""
    if "verify" not in stages:
        return None
    parity = read_parity(stages["verify"])
    rows = parity["rows"]
    columns = dict.fromkeys((row["engine"], row["dtype"]) for row in rows)
    return {
        "rows": len(rows),
        "held": sum(row["passed"] for row in rows),
        "diagnosis": list(parity["diagnosis"]),
        "engines": [
            {
                "engine": engine,
                "version": parity["engines"][engine].get(_PACKAGES[engine], ""),
                "precision": dtype,
                "forward": _largest(rows, engine, dtype, forward=True),
                "backward": _largest(rows, engine, dtype, forward=False),
            }
            for engine, dtype in columns
        ],
    }


def _largest(rows: list[dict[str, Any]], engine: str, dtype: str, *, forward: bool) -> float | None:
    """The largest relative difference of one engine's rows, None without a number."""
    found = [
        row["max_rel"]
        for row in rows
        if (row["engine"], row["dtype"]) == (engine, dtype)
        and row["max_rel"] is not None
        and row["part"] != "files"
        and (row["part"] in _FORWARD) == forward
    ]
    return max(found, default=None)
