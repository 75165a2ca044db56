"""Stage `infer`: what a run's predictors make of its own sequences and of unseen motions.

Networks need TensorFlow; `dsnet_plus` alone loads no framework.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData, load_paper_body
from bridge.errors import DsnetError
from bridge.exchange.dsnet import LATENTS_OF, code_of
from bridge.motion import MotionSequence, shape_rows, to_manifest
from bridge.motion.cuts import predict_between_cuts
from bridge.motion.sequences import end_to_end
from bridge.motion.splits import decoded_sequences
from bridge.options import PositiveFloat
from bridge.runs import Artifact, ArtifactWriter, Run
from bridge.runs.run import (
    INFER,
    INFER_PLUS,
    TRAIN,
    TRAIN_PLUS,
    best_alignment,
    body_model_path,
)
from bridge.runs.workers import on_any_node, progress, worker_pool
from bridge.tissue.trained_plus import NAME, TrainedPlus
from dsnet.prediction.models import PlusModel, codes_of
from dsnet.stages.frameworks import of_framework
from dsnet.stages.run_motions import MotionSet, find_motions, gather


@dataclass(frozen=True)
class InferConfig:
    """Predict the run's sequences at their whole length, then its MoSh-like motions, by every
    predictor that the run has trained.

    Costs about 0.1 ms a frame for each network and 1 ms for `dsnet_plus`, 1 GB. Gives
    `latents_<name>` of the networks in `infer`, offsets of `dsnet_plus` in `infer_plus`.
    """

    run: str = "demo"
    """Run whose predictors predict."""
    amass: Path | None = None
    """Folder of AMASS files or BVHs in place of the corpus's MoSh-like motions: docs/data.md."""
    amass_list: Path | None = None
    """Text file that names those of the folder that are meant, one a line: docs/data.md."""
    amass_fps: PositiveFloat | None = None
    """Frame rate of these files in frames per second, where they have a wrong one."""


PROFILES = {name: InferConfig(run=name) for name in ("smoke", "demo", "paper")}


def main(config: InferConfig) -> None:
    fps = config.amass_fps and f"{config.amass_fps:g}"
    for option, value in (("--amass-list", config.amass_list), ("--amass-fps", fps)):
        if value and config.amass is None:
            raise DsnetError(
                f"{option} {value} without --amass",
                "the folder of motions that it is about",
                f"Pass --amass DIR, or leave {option} out.",
            )
    run = Run(config.run)
    run.refuse_interrupted(TRAIN, TRAIN_PLUS)
    has_plus = run.finished(TRAIN_PLUS)
    works = [infer_networks(config)] if run.finished(TRAIN) or not has_plus else []
    works += [infer_plus(config)] if has_plus else []
    for work in works:  # a refusal of one comes before either begins
        work()


@dataclass(frozen=True, eq=False)
class TrainedNetworks:
    """The networks that a run has trained; another process is sent the artifact's place, and they
    are loaded where they predict."""

    train: Artifact
    names: tuple[str, ...]
    body_path: Callable[[], Path]  # of the run's body model, for which most predictors never ask

    @cached_property
    def by_name(self) -> dict[str, Callable[[NDArray, NDArray], NDArray]]:
        load_predictor = of_framework("load_predictor")
        body = cache(lambda: load_paper_body(str(self.body_path())))
        return {name: load_predictor(self.train, name, body) for name in self.names}

    def __reduce__(self) -> tuple[Any, ...]:
        return TrainedNetworks, (self.train, self.names, self.body_path)

    def latents(self, name: str, theta: NDArray, betas: NDArray) -> NDArray[np.float32]:
        """Latents (T, 100) from a fresh state, and so after a cut."""
        predict = self.by_name[name]
        return predict_between_cuts(lambda piece: predict(piece, betas), theta)


def infer_networks(config: InferConfig) -> Callable[[], Artifact]:
    """What makes `infer`, latents by every network; all that it reads is checked at once."""
    run = Run(config.run)
    trained, encoded = run.artifact(TRAIN), run.artifact("encode")
    names = trained.manifest["predictors"]
    networks = TrainedNetworks(trained, tuple(names), partial(body_model_path, run))
    _ = networks.by_name  # refused before any work
    sizes = {name: encoded.array(LATENTS_OF[code_of(trained, name)]).shape[1] for name in names}
    files = find_motions(run, config.amass, encoded, config.amass_list)

    def make(writer: ArtifactWriter) -> None:
        motions = gather(encoded, run, files, config.amass_fps)
        writer.put("theta", motions.theta, "rad, then m")
        writer.put("betas", motions.betas, "1")
        latents = {
            name: writer.array_file(
                f"latents_{name}", (len(motions.theta), sizes[name]), np.float32, "latent unit"
            )
            for name in names
        }
        rows = shape_rows(motions.sequences, motions.betas)

        def predict(networks: TrainedNetworks, sequence: MotionSequence) -> None:
            theta, betas = motions.theta[sequence.frames], motions.betas[rows[sequence.name]]
            for name, file in latents.items():
                file.write(sequence.start, networks.latents(name, theta, betas))

        with worker_pool(on_any_node("serial"), networks) as pool:
            for _ in pool.map(predict, motions.sequences):
                pass
        writer.record(
            sequences=to_manifest(motions.sequences),
            predictors={name: names[name]["label"] for name in names},
            codes={name: code_of(trained, name) for name in names},
            runtime="keras",
            default=trained.manifest["default"],
        )

    upstream = {TRAIN: trained, "encode": encoded} | _given(config, files)
    return partial(run.build, INFER, _options(config), make, data=trained.origin, upstream=upstream)


def infer_plus(config: InferConfig) -> Callable[[], Artifact]:
    """What makes `infer_plus`, offsets of the evaluated sequences by `dsnet_plus`; as above.

    `offsets_dsnet_plus`, `static_dsnet_plus` where the model has a static part, `theta`, `betas`
    and the index of the sequences.
    """
    run = Run(config.run)
    trained, align = run.artifact(TRAIN_PLUS), best_alignment(run)
    body, plus = load_paper_body(str(body_model_path(run))), TrainedPlus.load(trained)
    _ = align.array("theta"), align.array("betas")
    files = find_motions(run, config.amass, align, config.amass_list)

    def make(writer: ArtifactWriter) -> None:
        model = PlusModel(plus, body)
        _write_offsets(writer, model, body, gather(align, run, files, config.amass_fps))
        labels = {name: one["label"] for name, one in trained.manifest["predictors"].items()}
        default = trained.manifest["default"]
        writer.record(predictors=labels, default=default, runtime="onnx")

    upstream = {TRAIN_PLUS: trained, align.path.name: align} | _given(config, files)
    return partial(
        run.build, INFER_PLUS, _options(config), make, data=align.origin, upstream=upstream
    )


def _given(config: InferConfig, files: Sequence[Path]) -> dict[str, Artifact | Path]:
    """What a user's own files are called among the sources."""
    motions = {f"motion_{index}": path for index, path in enumerate(files)}
    return {**motions, **({"motion_list": config.amass_list} if config.amass_list else {})}


def _options(config: InferConfig) -> dict[str, Any]:
    options = asdict(config)
    if config.amass_list is None:  # as before there was such an option: what is done stays current
        del options["amass_list"]
    return options


def _write_offsets(
    writer: ArtifactWriter, model: PlusModel, body: BodyModelData, motions: MotionSet
) -> None:
    chosen = decoded_sequences(motions.sequences)
    placed = end_to_end(chosen)
    shape_of = shape_rows(motions.sequences, motions.betas)
    size = (sum(s.length for s in placed), body.vertex_count, 3)
    total = writer.array_file(f"offsets_{NAME}", size, np.float32, "m")
    has_static = bool(model.trained.static)
    static = writer.array_file(f"static_{NAME}", size, np.float32, "m") if has_static else None

    def predict(model: PlusModel, pair: tuple[MotionSequence, MotionSequence]) -> None:
        sequence, place = pair
        shape, theta = motions.betas[shape_of[sequence.name]], motions.theta[sequence.frames]
        at_nodes = predict_between_cuts(
            lambda part: np.stack([*codes_of(model, part, shape)]).transpose(0, 2, 1), theta
        )
        for rows in place.pieces():
            own = slice(rows.start - place.start, rows.stop - place.start)
            total_m = model.trained.nodes.spread(at_nodes[own])
            static_m = model.trained.static_m(body, shape, theta[own])
            if static is not None and static_m is not None:
                total_m += static_m
                static.write(rows.start, static_m)
            total.write(rows.start, total_m)

    pairs = list(zip(chosen, placed, strict=True))
    with worker_pool(on_any_node("threads"), model) as pool:
        done = pool.map(predict, pairs)
        for _ in progress(done, what=NAME, unit="sequence", total=len(pairs)):
            pass
    theta = np.concatenate([motions.theta[sequence.frames] for sequence in chosen])
    writer.put("theta", theta, "rad, then m")
    used = dict.fromkeys(shape_of[sequence.name] for sequence in chosen)
    writer.put("betas", motions.betas[list(used)], "1")
    writer.record(sequences=to_manifest(placed))
