"""The part of stage `train` that `dsnet_plus` has: oscillators learn the best alignment."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from bridge.body import load_body_model
from bridge.errors import DsnetError
from bridge.exchange import save_weights
from bridge.exchange.weights import load_checkpoint, refuse_nonfinite, save_checkpoint
from bridge.runs import Artifact, ArtifactWriter, Run
from bridge.runs.run import TRAIN_PLUS, best_alignment, body_model_path
from bridge.tissue.nodes import TissueNodes
from bridge.tissue.trained_plus import NAME, TrainedPlus
from tf_dsnet.oscillators.clips import KnownPeople, node_clips
from tf_dsnet.oscillators.static_part import NodeStatic, fit_static
from tf_dsnet.oscillators.training import PlusSettings, PlusTraining

LABEL = "DSNet+, oscillators"
DEPARTURES = (
    "not the paper's network: damped oscillators on the skin, driven by inertia and gravity",
    "learned from the robust aligner's offsets",
)
_REMEDY = "Look at the alignment's offsets; a study may lower `PlusSettings.lr`."


@dataclass(frozen=True)
class TrainPlusConfig(PlusSettings):
    """Fit `dsnet_plus` to the training sequences of the best alignment.

    Costs about two minutes on two cores for 40 sequences of 160 frames, 1 GB.
    """

    run: str = "demo"
    """Run whose aligned offsets are learned."""


def main(config: TrainPlusConfig, training: type[PlusTraining] = PlusTraining) -> None:
    """Run the stage: a result that is current is kept, one that was interrupted is continued.

    A study that trains in another way hands over a configuration and a training of its own.

    Raises
    ------
    DsnetError
        If the run has no alignment by the robust aligner, or training diverges.
    """
    run = Run(config.run)
    align = best_alignment(run)
    body_path = body_model_path(run)

    def make(writer: ArtifactWriter) -> None:
        _Fit(config, training, align, body_path, writer).write()

    run.build(
        TRAIN_PLUS,
        config,
        make,
        data=align.origin,
        upstream={align.path.name: align},
    )


class _Fit:
    """One training, with a checkpoint after every round."""

    def __init__(
        self,
        config: TrainPlusConfig,
        training: type[PlusTraining],
        align: Artifact,
        body_path: Path,
        writer: ArtifactWriter,
    ) -> None:
        self._config, self._align, self._writer = config, align, writer
        body = load_body_model(str(body_path))
        self._nodes = TissueNodes.of(body, config.nodes)
        self._people = KnownPeople.of(align)
        self._clips = node_clips(align, body, self._nodes, self._people, "train")
        self._training = training(config, body, self._nodes, self._people, self._clips)
        self._checkpoint = writer.checkpoints / f"{NAME}.safetensors"
        self._losses: list[float] = []
        features = self._clips[0].features.shape[1]
        self._static = NodeStatic.nothing(len(self._people.names), features, len(self._nodes))
        if (state := load_checkpoint(self._checkpoint)) is not None:
            self._resume(state)

    def write(self) -> None:
        """Train what is left and fill the artifact."""
        done = len(self._losses) // self._config.steps
        rounds = range(done, self._config.rounds)
        bar = tqdm(rounds, desc=NAME, unit="round", disable=None, initial=done,
                   total=self._config.rounds)  # fmt: skip
        for number in bar:
            self._losses += self._training.round(number, self._of_clips())
            if not np.isfinite(self._losses[-1]):
                received = f"{NAME} with a loss of {self._losses[-1]} in round {number + 1}"
                raise DsnetError(received, "a number", _REMEDY)
            if number + 1 in self._training.static_rounds():
                moving = self._training.simulate()
                self._static = fit_static(self._clips, moving, len(self._people.names))
            self._save()
            bar.set_postfix(loss=self._losses[-1])
        self._store()

    def _of_clips(self) -> list[NDArray[np.float32]]:
        return [self._static.of(clip) for clip in self._clips]

    def _save(self) -> None:
        losses = {"history/loss": np.array(self._losses)}
        state = {**self._training.state(), **self._static.arrays(), **losses}
        save_checkpoint(self._checkpoint, state)

    def _resume(self, state: dict[str, NDArray]) -> None:
        self._losses = state["history/loss"].tolist()
        self._static = NodeStatic.from_arrays(state)
        self._training.restore(state)

    def _store(self) -> None:
        trained = self._training.trained(self._static.at_vertices(self._constants_m()))
        arrays = trained.arrays()
        refuse_nonfinite(arrays, NAME, _REMEDY)
        save_weights(self._writer.file_path(f"{NAME}.safetensors"), arrays)
        loss = np.array(self._losses, np.float32)
        self._writer.put(f"loss_{NAME}", loss, "share of the windows' energy, and of quiet ones")
        self._writer.record(
            predictors={NAME: {"label": LABEL, "departures": list(DEPARTURES)}},
            default=NAME,
            people=self._people.names,
            parameters={"learned": int(sum(a.size for a in _learned(trained)))},
            sequences_trained_on=len(self._clips),
            static={"chosen": self._static.chosen, "left_out_error": self._static.left_out_error},
        )

    def _constants_m(self) -> NDArray[np.float32]:
        """(P, V, 3) each person's mean of what nodes and pose leave, at all vertices."""
        offsets_m = self._align.array("offsets")
        sums = np.zeros((len(self._people.names), *offsets_m.shape[1:]))
        if not self._static.constant_m.any():
            return sums.astype(np.float32)
        frames = np.zeros(len(sums))
        for clip, moving in zip(self._clips, self._training.simulate(), strict=True):
            by_pose = np.tensordot(clip.features, self._static.by_pose_m, 1)
            at_nodes = (moving + by_pose).mean(axis=0, keepdims=True)
            own = np.asarray(offsets_m[clip.sequence.frames]).mean(axis=0, dtype=np.float64)
            sums[clip.person] += len(clip) * (own - self._nodes.spread(at_nodes)[0])
            frames[clip.person] += len(clip)
        return (sums / frames[:, None, None]).astype(np.float32)


def _learned(trained: TrainedPlus) -> list[NDArray]:
    weights, static = trained.weights, trained.static
    return [*weights.base.values(), weights.slopes, weights.stiffening_power, weights.residual,
            weights.taps, static.constant_m, static.by_pose_m]  # fmt: skip
