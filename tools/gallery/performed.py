"""Bodies for the gallery: what a predictor makes of a motion, and how it really went."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.body.posing import Smpl
from bridge.errors import DsnetError
from bridge.motion import unpack_theta
from bridge.motion.splits import kind_of
from bridge.runs import Run
from dsnet.prediction.moving_body import MovingBody
from dsnet.view.clip_list import open_truth

TAIL = "_poses.npz"
TRUTH = "truth (simulated)"


@dataclass(frozen=True, eq=False)
class Performed:
    """All frames of one body."""

    label: str
    """What stands over it."""
    vertices_m: NDArray[np.float32]
    """(T, V, 3) in the world, metres, y up."""
    sizes_m: NDArray[np.float32]
    """(T, V) lengths of its skin offsets, metres."""


def performed(label: str, moving: MovingBody) -> Performed:
    """What a moving body does."""
    pieces = list(moving)
    sizes_m = [np.linalg.norm(piece.offsets_m, axis=-1) for piece in pieces]
    return Performed(
        label,
        np.concatenate([piece.vertices_m for piece in pieces]),
        np.concatenate(sizes_m),
    )


class TrueBody(MovingBody):
    """A moving body beside another, by offsets (T, V, 3) that are known and not predicted."""

    def __init__(self, beside: MovingBody, offsets_m: NDArray[np.float32]) -> None:
        super().__init__(replace(beside.trained, label=TRUTH), beside.motion)
        self._offsets_m = offsets_m

    def _offset_pieces(self) -> Iterator[NDArray[np.float32]]:
        return iter([self._offsets_m])


@dataclass(frozen=True, eq=False)
class TrueMotion:
    """What really moved in a synthetic sequence of T frames."""

    theta: NDArray[np.floating]
    """(T, 69) true pose."""
    betas: NDArray[np.floating]
    """(10,) true shape."""
    offsets_m: NDArray[np.float32]
    """(T, V, 3) true offsets in the rest pose, metres."""


def true_performance(run: Run, name: str, body: BodyModelData) -> Performed:
    """How a sequence of a synthetic run's corpus really went; see `truth_of`."""
    truth = truth_of(run, name)
    pose, trans_m = unpack_theta(truth.theta)
    vertices_m = Smpl(body).person(truth.betas).pose(pose, trans_m, truth.offsets_m)
    return Performed(TRUTH, vertices_m, np.linalg.norm(truth.offsets_m, axis=-1))


def truth_of(run: Run, name: str) -> TrueMotion:
    """What really moved in a sequence of a synthetic run's corpus.

    Raises
    ------
    DsnetError
        If the run has no truth of it.
    """
    truth, every = open_truth(run, run.artifact("corpus").origin), slice(None)
    if truth is None or name not in truth.sequences:
        raise DsnetError(
            f"run {run.name!r} without the truth of {name}",
            "a run of the synthetic corpus",
            "Name the run of `./reproduce.sh`.",
        )
    offsets_m = np.asarray(truth.offsets_m(name, every), np.float32)
    return TrueMotion(truth.frames("theta", name, every), truth.betas(name), offsets_m)


def motion_of_kind(run: Run, kind: str) -> Path:
    """The first of a run's test motions of a kind, by a person that it was trained on if there is
    one: an AMASS file of its corpus, `<sequence>_poses.npz`.

    Raises
    ------
    DsnetError
        If there is none.
    """
    corpus = run.artifact("corpus")
    people = {sequence["subject"] for sequence in corpus.manifest["sequences"]}
    names = [Path(name).name for name in corpus.manifest["files"] if name.endswith(TAIL)]
    of_kind = [
        (person not in people, name)
        for name in names
        for person, _, motion in [name.removesuffix(TAIL).partition("_")]
        if kind_of(motion) == kind
    ]
    if not of_kind:
        raise DsnetError(
            f"run {run.name!r} without a motion of the kind {kind}",
            "a run of the synthetic corpus, profile demo",
            "Name the run of `./reproduce.sh`.",
        )
    _, first = min(of_kind)
    return corpus.file(next(n for n in corpus.manifest["files"] if Path(n).name == first))


def sequence_of(path: Path) -> str:
    """The name that a test motion's sequence has in its run."""
    return path.name.removesuffix(TAIL)


def shown_dsnet(run: Run) -> str:
    """The reading of the paper's DSNet that stands for it in the run's report."""
    return str(run.artifact("train").manifest["default"])
