"""What `dsnet predict` wrote of a folder of motions, as a data set: offsets beside their motion."""

from __future__ import annotations

import operator
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, SupportsIndex, overload

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData, load_body_model
from bridge.body.vertex_order import VERTICES, check_vertex_order
from bridge.errors import DsnetError
from bridge.motion import unpack_theta
from bridge.runs import Artifact, read_artifact
from bridge.runs.files import MANIFEST
from dsnet.prediction.interpolation import Interpolation, NodeOffsets

KIND = "prediction"
"""Of the artifacts that `dsnet predict` writes."""


@dataclass(frozen=True, eq=False)
class FleshClip:
    """One motion of T frames, and how the flesh of a body of V vertices moved in it."""

    name: str
    """Path of its folder, from the data set's on: `CMU/05/05_06_poses`."""
    offsets_m: NDArray[np.floating] | NodeOffsets
    """(T, V, 3) in the rest pose, metres: what is posed is `v_template + shapedirs @ betas +
    offsets_m[t]`. A memory-mapped array, float32 or float16 as written, or, of `nodes16`, what
    computes the frames that it is asked for, float32: either gives arrays by `offsets_m[10:20]`."""
    theta: NDArray[np.float32]
    """(T, 69) axis-angle of 22 joints, radians, and the root's translation, metres, y up:
    memory-mapped."""
    betas: NDArray[np.float64]
    """(S,) of the body that moved, which are the motion file's only if it is of their kind."""
    fps: float
    """Frames a second: 60."""
    gender: str
    """Of the body."""
    vertices: str
    """In which order they are: `bridge.body.vertex_order.vertex_order` of the body."""
    faces: NDArray[np.int64] | None = None
    """(F, 3) of the body that `load_flesh` was given."""

    def __len__(self) -> int:
        return len(self.theta)

    @property
    def pose(self) -> NDArray[np.float32]:
        """(T, 22, 3) joint rotations, axis-angle, radians, the root's first."""
        return np.asarray(unpack_theta(self.theta)[0], np.float32)

    @property
    def trans_m(self) -> NDArray[np.float32]:
        """(T, 3) translation of the root, y up."""
        return np.asarray(unpack_theta(self.theta)[1], np.float32)


class Flesh(Sequence[FleshClip]):
    """The predicted motions of a folder, in order of path: `len`, `[i]`, iteration.

    A map-style data set for PyTorch's `DataLoader`; clips differ in length, so pass a `collate_fn`
    that pads or cuts them. Nothing is kept open; processes of a loader may have copies.
    """

    def __init__(self, folder: Path, paths: Sequence[Path], body: BodyModelData | None) -> None:
        self._folder, self._paths = folder, paths
        self._faces = None if body is None else body.faces
        self._interpolations: dict[str, Interpolation] = {}

    def __len__(self) -> int:
        return len(self._paths)

    def __repr__(self) -> str:
        return f"<Flesh {self._folder}: {len(self)} motions>"

    @property
    def names(self) -> list[str]:
        """Of all clips, without reading them."""
        return [path.relative_to(self._folder).as_posix() for path in self._paths]

    @overload
    def __getitem__(self, index: SupportsIndex) -> FleshClip: ...
    @overload
    def __getitem__(self, index: slice) -> list[FleshClip]: ...
    def __getitem__(self, index: SupportsIndex | slice) -> FleshClip | list[FleshClip]:
        if isinstance(index, slice):
            return [self._read(path) for path in self._paths[index]]
        return self._read(self._paths[operator.index(index)])

    def __iter__(self) -> Iterator[FleshClip]:
        return map(self._read, self._paths)

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"_interpolations": {}}

    def _read(self, path: Path) -> FleshClip:
        made = read_artifact(path, KIND)
        manifest = made.manifest
        if "theta" not in manifest["arrays"]:
            raise DsnetError(
                f"{path}, without the motion of its offsets",
                "theta, which comes with those of a folder of motions and with nodes",
                "Pass a folder to `dsnet predict`, or --write nodes16.",
            )
        return FleshClip(
            name=path.relative_to(self._folder).as_posix(),
            offsets_m=self._offsets_m(made),
            theta=made.array("theta"),
            betas=np.array(manifest["betas"], np.float64),
            fps=float(manifest["fps"]),
            gender=manifest["gender"],
            vertices=manifest[VERTICES],
            faces=self._faces,
        )

    def _offsets_m(self, made: Artifact) -> NDArray[np.floating] | NodeOffsets:
        arrays = made.manifest["arrays"]
        if "offsets" in arrays:
            return made.array("offsets")
        digest = made.manifest["interpolation"]
        if digest not in self._interpolations:
            folders = (made.path, *made.path.resolve().parents)
            self._interpolations[digest] = Interpolation.load(folders, digest)
        constant_m = made.array("constant") if "constant" in arrays else None
        gains = made.array("gains") if "gains" in arrays else None
        return NodeOffsets(made.array("nodes"), self._interpolations[digest], constant_m, gains)


def load_flesh(folder: Path | str, body: BodyModelData | Path | str | None = None) -> Flesh:
    """The offsets of every motion of a folder that `dsnet predict` wrote.

    Only manifests are read; arrays are memory-mapped when a clip is taken, after their bytes were
    found to be those that were written.

    Parameters
    ----------
    folder : as `--out` of `dsnet predict --write offsets`, `offsets16` or `nodes16`, or a folder in
        it.
    body : on which the offsets will be put, what `dsnet.load_body` takes or gives: compared by the
        order of its vertices, whatever its gender and shape. It also gives `faces`.

    Returns
    -------
    A sequence of `FleshClip`, which `torch.utils.data.DataLoader` takes as it is.

    Raises
    ------
    DsnetError
        If the folder holds no predicted offsets or some without their order of vertices, or the
        body has its vertices in another order; and where a clip is taken that is damaged, or has no
        motion beside it, as a single file's has only with nodes.
    """
    folder = Path(folder)
    moved = body if isinstance(body, BodyModelData | None) else load_body_model(body)
    whole = (path.parent for path in sorted(folder.rglob(MANIFEST)) if _is_whole(path, folder))
    orders = {path: order for path in whole if (order := _order_of_offsets(path))}
    if not orders:
        raise DsnetError(
            f"{folder}, which holds no predicted offsets",
            "a folder that `dsnet predict --write offsets16` or the like wrote",
            "Check the path.",
        )
    if moved is not None:
        for order, path in {order: path for path, order in orders.items()}.items():
            check_vertex_order(order, str(path), moved)
    return Flesh(folder, [*orders], moved)


def _is_whole(manifest: Path, folder: Path) -> bool:
    """Whether nobody is still writing there."""
    return not any(part.startswith(".") for part in manifest.relative_to(folder).parts)


def _order_of_offsets(path: Path) -> str:
    """Empty of what holds no predicted offsets."""
    manifest = read_artifact(path).manifest
    if manifest["kind"] != KIND or not {"offsets", "nodes"} & {*manifest["arrays"]}:
        return ""
    if VERTICES not in manifest:
        raise DsnetError(
            f"{path}, which does not say the order of its vertices",
            "offsets that this version wrote",
            "Predict again: the same `dsnet predict` makes anew what lacks it.",
        )
    return str(manifest[VERTICES])
