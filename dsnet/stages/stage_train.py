"""`dsnet train`: networks learn latents, `dsnet_plus` learns offsets."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from tyro.conf import Fixed

from bridge.errors import DsnetError, notify
from bridge.exchange.dsnet import DSNETS, LATENTS_OF, LITERAL_DSNETS
from bridge.exchange.train_options import NetworksRecord, TrainPlusConfig
from bridge.installation import require_packages_of
from bridge.options import PositiveInt
from bridge.plugins import entry_named
from bridge.runs import Run
from bridge.runs.run import ALIGNMENT, best_alignment_of
from bridge.tissue.trained_plus import NAME as PLUS
from dsnet.prediction.models import simulate_nodes
from dsnet.stages.frameworks import of_framework


@dataclass(frozen=True)
class TrainConfig(NetworksRecord):
    """Train predictors on the training sequences.

    Costs 1 GB of memory, and two minutes for `dsnet_plus`; the report says what an epoch of the
    networks took. Writes weights and losses: of the networks to `train`,
    of `dsnet_plus` to `train_plus`. The weights of the last epoch are kept: choosing the epoch with
    the least validation error would make that a training error.
    """

    run: str = "demo"
    """Run whose latents or offsets are learned."""
    markers: Path | None = None
    """Folder of motions with skin markers. Writes `train_markers` alone: `dsnet_plus`, the run's or
    else the packaged one, with the frequency, damping and preload of these people's soft tissue.
    About a minute a person."""
    tensorboard: bool = False
    """Write the networks' losses also as TensorBoard reads them, to `runs/RUN/tensorboard`."""
    rounds: PositiveInt = 8
    """Training rounds of `dsnet_plus`; each begins with a simulation of every clip."""
    plus: Fixed[TrainPlusConfig] = field(default_factory=TrainPlusConfig)
    """How else `dsnet_plus` is trained."""


PROFILES: dict[str, TrainConfig] = {
    "smoke": TrainConfig(
        run="smoke", epochs=20, rounds=4, plus=TrainPlusConfig(steps=8, nodes=300)
    ),
    "demo": TrainConfig(run="demo", epochs=750),
    "paper": TrainConfig(run="paper", epochs=5000, checkpoint_every=250, rounds=24),
}


def main(config: TrainConfig) -> None:
    run = Run(config.run)
    if config.markers:
        if config.predictors:
            raise DsnetError(
                "--predictors with --markers",
                "one of them: markers give constants of dsnet_plus",
                "Leave one out.",
            )
        # Networks are trained without its optimiser and its pages.
        from dsnet.fitting.train import train_on_markers

        train_on_markers(run, config.markers)
        return
    require_packages_of("tf_dsnet")  # before a run is looked for that only it could train
    names = config.predictors or _trainable(run)
    networks = [name for name in names if name != PLUS]
    for name in names:
        entry_named(name, "predictor", {**of_framework("registered_predictors")(), PLUS: None})
    if networks:
        own: dict[str, Any] = {f.name: getattr(config, f.name) for f in fields(NetworksRecord)}
        record = replace(NetworksRecord(**own), predictors=tuple(networks))
        of_framework("train_networks")(run, record, tensorboard=config.tensorboard)
    if PLUS in names:
        of_framework("train_plus")(plus_config(config), simulate_nodes)


def plus_config(config: TrainConfig) -> TrainPlusConfig:
    return replace(config.plus, run=config.run, seed=config.seed, rounds=config.rounds)


def _trainable(run: Run) -> list[str]:
    """The product's predictors that the run can train; a pipeline that it began is not left out."""
    has_plus = best_alignment_of(run)
    if has_plus and not run.finished(ALIGNMENT) and not run.finished("encode"):
        notify(f"left out: {', '.join(DSNETS)}, which needs 'encode'")
        return [PLUS]
    there = run.artifact("encode").manifest["arrays"]  # or says what to run
    literal = [name for code, name in LITERAL_DSNETS.items() if LATENTS_OF[code] in there]
    if not has_plus:
        notify(f"left out: {PLUS}, which needs an alignment by the robust aligner")
    return [*DSNETS, *literal, *([PLUS] if has_plus else [])]
