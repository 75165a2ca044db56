"""Stage `infer`: what a run's predictors make of its own sequences and of unseen motions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from bridge.exchange.dsnet import LATENTS_OF, code_of
from bridge.motion import subject_rows, to_manifest
from bridge.runs import ArtifactWriter, Run
from bridge.runs.run import INFER, TRAIN, TRAIN_PLUS, body_model_path
from bridge.runtime.run_motions import AmassOptions, MotionSet, find_motions, gather
from tf_dsnet import stage_infer_plus
from tf_dsnet.stage_infer_plus import InferPlusConfig
from tf_dsnet.trained_predictors import Performance, TrainedPredictors


@dataclass(frozen=True)
class InferConfig(AmassOptions):
    """Predict the run's sequences at their whole length, then its MoSh-like motions, by every
    predictor that the run has trained.

    Costs about 0.1 ms a frame for each network and 1 ms for `dsnet_plus`, 1 GB. Gives
    `latents_<name>` of the networks in `infer`, offsets of `dsnet_plus` in `infer_plus`.
    """

    run: str = "demo"
    """Name of the run whose predictors predict."""


PROFILES = {name: InferConfig(run=name) for name in ("smoke", "demo", "paper")}


def main(config: InferConfig) -> None:
    """Run the stage; a result that is current is kept.

    Raises
    ------
    DsnetError
        If the run has trained nothing, or an AMASS file is not one.
    """
    config.check()
    run = Run(config.run)
    has_plus = run.finished(TRAIN_PLUS)
    if run.finished(TRAIN) or not has_plus:
        _by_networks(config, run)
    if has_plus:
        own = InferPlusConfig(config.run, amass=config.amass, amass_fps=config.amass_fps)
        stage_infer_plus.main(own)


def _by_networks(config: InferConfig, run: Run) -> None:
    trained, encoded = run.artifact(TRAIN), run.artifact("encode")
    default, names = trained.manifest["default"], trained.manifest["predictors"]
    predictors = TrainedPredictors(trained, tuple(names), partial(body_model_path, run))
    _ = predictors.by_name  # refused before any work
    sizes = {name: encoded.array(LATENTS_OF[code_of(trained, name)]).shape[1] for name in names}
    files = find_motions(run, config.amass, encoded)

    def make(writer: ArtifactWriter) -> None:
        motions = gather(encoded, run, files, config.amass_fps)
        writer.put("theta", motions.theta, "rad, then m")
        writer.put("betas", motions.betas, "1")
        frames = len(motions.theta)
        predictors.write(
            performances(motions),
            {
                name: writer.array_file(
                    f"latents_{name}", (frames, sizes[name]), np.float32, "latent unit"
                )
                for name in names
            },
        )
        writer.record(
            sequences=to_manifest(motions.sequences),
            predictors={name: names[name]["label"] for name in names},
            codes={name: code_of(trained, name) for name in names},
            default=default,
        )

    upstream = {TRAIN: trained, "encode": encoded}
    upstream |= {f"motion_{index}": path for index, path in enumerate(files)}
    run.build(INFER, config, make, data=trained.origin, upstream=upstream)


def performances(motions: MotionSet) -> Iterator[Performance]:
    """Each sequence with its own motion and shape."""
    rows = subject_rows(motions.sequences)
    for one in motions.sequences:
        shape = motions.betas[rows[one.subject]]
        yield Performance(one.start, motions.theta[one.frames], shape)
