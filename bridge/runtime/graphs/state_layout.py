"""The state of a deployable graph: one row of numbers a character, zero where she begins."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass

from bridge.runtime.graphs.onnx_values import Value, ValueGraph


@dataclass(frozen=True)
class StateLayout:
    """Named arrays side by side in one row; none is empty."""

    shapes: Mapping[str, tuple[int, ...]]
    """Of each array of one character, in the row's order."""

    @property
    def size(self) -> int:
        """Length of a row."""
        return sum(self._sizes)

    @property
    def _sizes(self) -> list[int]:
        return [math.prod(shape) for shape in self.shapes.values()]

    def columns(self, name: str) -> slice:
        """Where an array lies in a row."""
        names = list(self.shapes)
        start = sum(self._sizes[: names.index(name)])
        return slice(start, start + math.prod(self.shapes[name]))

    def read(self, state: Value) -> dict[str, Value]:
        """The arrays (B, ...) of a state (B, S)."""
        parts = state.split(1, self._sizes)
        return {
            name: part.reshape(0, *shape)
            for (name, shape), part in zip(self.shapes.items(), parts, strict=True)
        }

    def written(self, graph: ValueGraph, arrays: Mapping[str, Value]) -> Value:
        """(B, S) of all arrays (B, ...)."""
        rows = [
            arrays[name].reshape(-1, size)
            for name, size in zip(self.shapes, self._sizes, strict=True)
        ]
        return graph.concat(rows, 1)

    def as_text(self) -> str:
        """JSON: [name, first column, shape] of each array."""
        entries, start = [], 0
        for (name, shape), size in zip(self.shapes.items(), self._sizes, strict=True):
            entries.append([name, start, list(shape)])
            start += size
        return json.dumps(entries)
