"""From nodes to vertices: the fixed matrix that makes offsets of all vertices of 500 nodes'.

`dsnet_plus` computes offsets of nodes. Those of vertex v are

    offsets_v = sum_i shares_vi nodes_owners_vi + constant_v

where gains, also of single body parts, are in the shares; those that strain limits in each frame
(`dsnet.prediction.gains`) come as numbers of parts, by which the sum is multiplied. What the pose
alone does is at the nodes too. The constant is a known person's, and zero for everybody else.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, overload

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.exchange.weights import load_checkpoint, save_checkpoint
from bridge.runs.files import arrays_sha256
from bridge.tissue.nodes import per_frame, shares_matrix

_FRAMES_AT_ONCE = 256


@dataclass(frozen=True, eq=False)
class Interpolation:
    """The same for all motions of a body that are moved with the same gains."""

    owners: NDArray[np.int32]
    """(V, 8) nodes that share each vertex."""
    shares: NDArray[np.float32]
    """(V, 8) what a vertex takes of them, all zero where no flesh is."""
    node_count: int
    fading: NDArray[np.float32] | None = None
    """(V, 11) how much of each part's gain a vertex has, where gains differ from frame to frame."""

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the arrays."""
        return arrays_sha256(self._arrays())

    @cached_property
    def matrix(self) -> sp.csr_matrix:
        """(V, K) with which `matrix @ nodes` (K, 3) gives offsets (V, 3)."""
        return shares_matrix(self.owners, self.shares, self.node_count)

    def offsets_m(
        self, nodes_m: NDArray, constant_m: NDArray | None = None, gains: NDArray | None = None
    ) -> NDArray[np.float32]:
        """(T, V, 3) offsets of offsets (T, K, 3) of the nodes and a constant (V, 3), metres, by
        gains (T, 11) of parts if there are any."""
        at_nodes = np.asarray(nodes_m, np.float32)
        offsets_m = per_frame(self.matrix, at_nodes)
        offsets_m = offsets_m if constant_m is None else offsets_m + constant_m
        if gains is None or self.fading is None:
            return offsets_m
        return offsets_m * (gains @ self.fading.T)[..., None]

    @staticmethod
    def name(digest: str) -> str:
        """Of the file, in a folder of predictions or in a prediction."""
        return f"interpolation-{digest[:16]}.safetensors"

    def save(self, folder: Path) -> None:
        """Once a folder, whoever comes first: what is there under its name is the same."""
        path = folder / self.name(self.digest)
        if load_checkpoint(path) is None:
            folder.mkdir(parents=True, exist_ok=True)
            save_checkpoint(path, self._arrays())

    @classmethod
    def load(cls, folders: Iterable[Path], digest: str) -> Interpolation:
        """From the first of some folders that has it; `DsnetError` if none has it as written."""
        name, where = cls.name(digest), [*folders]
        for folder in where:
            if (arrays := load_checkpoint(folder / name)) is None:
                continue
            if arrays_sha256(arrays) == digest:
                count = int(arrays["node_count"][0])
                return cls(arrays["owners"], arrays["shares"], count, arrays.get("fading"))
        raise DsnetError(
            f"nodes in {where[0]} without {name}, which says how they move vertices",
            "it in the folder that `dsnet predict` wrote, unchanged",
            "Copy it beside them, or run the same command again.",
        )

    def _arrays(self) -> dict[str, NDArray[Any]]:
        count = np.array([self.node_count], np.int64)
        fading = {} if self.fading is None else {"fading": self.fading}
        return {"owners": self.owners, "shares": self.shares, "node_count": count, **fading}


class NodeOffsets:
    """Offsets (T, V, 3) of all vertices, float32, metres, computed as they are read.

    `offsets[10:20]`, `offsets[3]` and `offsets[[1, 5]]` are arrays of these frames, and
    `np.asarray(offsets)` is all.

    Parameters
    ----------
    nodes_m : (T, K, 3) metres, before any gain.
    constant_m : (V, 3) metres, that each frame has besides.
    gains : (T, 11) of parts, where they differ from frame to frame.
    """

    def __init__(
        self,
        nodes_m: NDArray,
        interpolation: Interpolation,
        constant_m: NDArray | None = None,
        gains: NDArray | None = None,
    ) -> None:
        self.nodes_m, self.interpolation, self.constant_m = nodes_m, interpolation, constant_m
        self.gains = gains
        self.shape = (len(nodes_m), len(interpolation.owners), 3)
        self.dtype, self.ndim = np.dtype(np.float32), 3

    def __len__(self) -> int:
        return self.shape[0]

    def __repr__(self) -> str:
        return f"<offsets {self.shape} of {self.nodes_m.shape[1]} nodes>"

    @overload
    def __getitem__(self, frames: int) -> NDArray[np.float32]: ...
    @overload
    def __getitem__(self, frames: slice | NDArray[np.integer]) -> NDArray[np.float32]: ...
    def __getitem__(self, frames: Any) -> NDArray[np.float32]:
        nodes_m = self.nodes_m[frames]
        gains = None if self.gains is None else self.gains[frames]
        if nodes_m.ndim == 2:
            gains = None if gains is None else gains[None]
            return self.interpolation.offsets_m(nodes_m[None], self.constant_m, gains)[0]
        return self.interpolation.offsets_m(nodes_m, self.constant_m, gains)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        offsets_m = np.empty(self.shape, dtype or self.dtype)
        for start in range(0, len(self), _FRAMES_AT_ONCE):
            frames = slice(start, start + _FRAMES_AT_ONCE)
            offsets_m[frames] = self[frames]
        return offsets_m
