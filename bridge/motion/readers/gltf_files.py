"""What a glTF or GLB says, and the numbers in its buffers; nothing of it is believed unchecked."""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from bridge.runs.untrusted import MOST_JSON_BYTES, is_plain_name, open_regular

_MOST_BYTES = 1 << 30
_MOST_NODES = 20_000
_JSON, _BINARY = 0x4E4F534A, 0x004E4942
_TYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}
MOVED = ("translation", "rotation", "scale")
"""What of a node an animation moves."""


@dataclass(frozen=True, eq=False)
class GltfFile:
    """What a file says, and its buffers."""

    path: Path
    said: dict[str, Any]
    binary: bytes

    @classmethod
    def opened(cls, path: Path) -> GltfFile:
        """ValueError if it is no glTF 2."""
        with open_regular(path, _MOST_BYTES) as file:
            if file.read(4) != b"glTF":
                file.seek(0)
                said, binary = file.read(min(MOST_JSON_BYTES + 1, int(file.largest_read))), b""
            else:
                version, _ = struct.unpack("<II", file.read(8))
                length, kind = struct.unpack("<II", file.read(8))
                if version != 2 or kind != _JSON or length > MOST_JSON_BYTES:
                    raise ValueError("no glTF 2")
                said, head = file.read(length), file.read(8)
                length, kind = struct.unpack("<II", head) if len(head) == 8 else (0, _BINARY)
                binary = file.read(min(length, _MOST_BYTES)) if kind == _BINARY else b""
        if len(said) > MOST_JSON_BYTES:
            raise ValueError("a text of too many bytes")
        found = cls(path, json.loads(said), binary)
        if not isinstance(found.said, dict) or not str(found.said["asset"]["version"])[:1] == "2":
            raise ValueError("no glTF 2")
        if len(found.list("nodes")) > _MOST_NODES:
            raise ValueError(f"more than {_MOST_NODES} nodes")
        return found

    def list(self, name: str) -> list[dict[str, Any]]:
        return self.said.get(name, [])

    @property
    def animations(self) -> list[dict[str, Any]]:
        """Those that move nodes."""
        return [one for one in self.list("animations") if channels(one)]

    @cached_property
    def humanoid(self) -> dict[int, str]:
        """VRM's names of bones by node; empty of other files."""
        extensions = self.said.get("extensions", {})
        if bones := extensions.get("VRM", {}).get("humanoid", {}).get("humanBones"):
            return {bone["node"]: str(bone["bone"]) for bone in bones if bone.get("node", -1) >= 0}
        for name in ("VRMC_vrm", "VRMC_vrm_animation"):
            if bones := extensions.get(name, {}).get("humanoid", {}).get("humanBones"):
                return {bone["node"]: name for name, bone in bones.items()}
        return {}

    def array(self, number: int) -> NDArray[np.float64]:
        """(count, width) of an accessor."""
        accessor = self.list("accessors")[number]
        count, width = int(accessor["count"]), _WIDTHS[accessor["type"]]
        if "bufferView" in accessor:
            dense = self._numbers(accessor, count, width)
        elif count * width > _MOST_BYTES // 8:
            raise ValueError(f"an array of {count} without numbers")
        else:
            dense = np.zeros((count, width))
        if sparse := accessor.get("sparse"):
            where = self._numbers(sparse["indices"], int(sparse["count"]), 1).astype(int)[:, 0]
            values = {"componentType": accessor["componentType"]} | sparse["values"]
            dense[where] = self._numbers(values, int(sparse["count"]), width)
        kind = np.dtype(_TYPES[accessor["componentType"]])
        if accessor.get("normalized") and kind.kind != "f":
            dense = np.maximum(dense / np.iinfo(kind).max, -1.0)
        return dense

    def _numbers(self, where: Mapping[str, Any], count: int, width: int) -> NDArray[np.float64]:
        kind = np.dtype(_TYPES[where["componentType"]])
        view = self.list("bufferViews")[where["bufferView"]]
        if compressed := [name for name in view.get("extensions", {}) if "compression" in name]:
            raise ValueError(f"compressed by {compressed[0]}: export it without")
        begin, size = int(view.get("byteOffset", 0)), int(view["byteLength"])
        stored = self._buffers[view["buffer"]][begin : begin + size]
        steps = (int(view.get("byteStride") or width * kind.itemsize), kind.itemsize)
        numbers = np.ndarray((count, width), kind, stored, int(where.get("byteOffset", 0)), steps)
        return numbers.astype(np.float64)

    @cached_property
    def _buffers(self) -> list[memoryview]:
        return [memoryview(self._buffer(buffer.get("uri"))) for buffer in self.list("buffers")]

    def _buffer(self, uri: str | None) -> bytes:
        if uri is None:
            return self.binary
        if uri.startswith("data:"):
            return base64.b64decode(uri.partition(",")[2])
        if not is_plain_name(name := unquote(uri)):
            raise ValueError(f"with numbers in {uri[:80]!r}, not in its folder")
        try:
            with open_regular(self.path.parent / name, _MOST_BYTES) as file:
                return file.read()
        except FileNotFoundError as error:
            raise ValueError(f"without its file {name}") from error


def channels(animation: Mapping[str, Any]) -> list[tuple[int, str, int]]:
    """Of each that moves a node: the node, what of it moves, and the sampler."""
    return [
        (channel["target"]["node"], channel["target"]["path"], channel["sampler"])
        for channel in animation["channels"]
        if "node" in channel["target"] and channel["target"]["path"] in MOVED
    ]
