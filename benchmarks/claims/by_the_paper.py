"""A variant of DSNet trained by the paper's words, and the autoencoder's decoder in Keras."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.claims.references import Decode
from benchmarks.systems.dsnet_variants import DsnetVariant
from bridge.exchange.dsnet import AUTOENCODER, CodeName, Scaling, UnpaddedClip, make_clips
from bridge.exchange.engine import NORMALISER
from bridge.exchange.train_options import PredictorSettings
from bridge.exchange.weights import load_autoencoder
from bridge.runs import Artifact
from tf_dsnet.framework import tf
from tf_dsnet.mesh_autoencoder import KerasMeshAutoencoder, assign_weights
from tf_dsnet.predictors import BodyOf, PredictMotion, TrainingData
from tf_dsnet.trainer import DsnetTraining, Trainer


@dataclass(frozen=True)
class ByThePaper:
    """An entry of the registry: nothing scaled, Adam's rate 0.0001, the last epoch (Section 5)."""

    variant: DsnetVariant
    code: CodeName = AUTOENCODER

    @property
    def name(self) -> str:
        """The variant's."""
        return self.variant.name

    @property
    def label(self) -> str:
        """The variant's, which learns another code here."""
        return self.variant.label.replace("on PCA latents", "by the paper")

    def departures(self, settings: PredictorSettings) -> tuple[str, ...]:
        """What the variant changes."""
        return (self.variant.change,) if self.variant.change else ()

    def training(
        self, settings: PredictorSettings, data: TrainingData, checkpoint: Path
    ) -> DsnetTraining:
        """Begin training, or go on from `checkpoint` if that file is there."""
        told = self.variant.told
        train, validation = (
            [replace(clip, inputs=told(clip.inputs, data.body)) for clip in part]
            for part in (data.train, data.validation)
        )
        scaling = unscaled(train[0])
        clips, held_out = (
            make_clips(part, scaling, settings.frames) for part in (train, validation)
        )
        people = len({clip.betas.tobytes() for clip in data.train})
        trainer = Trainer(
            clips,
            lr=settings.lr_faithful,
            batch_size=settings.batch_size,
            seed=settings.seed,
            build=partial(self.variant.build, people=people),
        )
        self.variant.prepare(trainer.model, clips)
        trainer.trace()
        return DsnetTraining(self.name, trainer, scaling, held_out, checkpoint)

    def load(self, arrays: Mapping[str, NDArray], body: BodyOf) -> PredictMotion:
        """The trained network, applied to whole motions."""
        return self.variant.load(arrays, body)


def unscaled(clip: UnpaddedClip) -> Scaling:
    """The identity for as many numbers as a clip has."""
    sizes = (clip.inputs.shape[1], clip.latents.shape[1])
    return Scaling(*(np.full(size, fill, np.float32) for size in sizes for fill in (0, 1)))


def keras_decoder(trained: Artifact) -> Decode:
    """The decoder of a finished `train-ae`, with its normaliser."""
    weights, architecture = load_autoencoder(trained)
    mean_m, scale_m = (weights.pop(name) for name in NORMALISER)
    network = KerasMeshAutoencoder(tuple(architecture["widths"]))
    assign_weights(network.model, weights)
    size = network.decoder.input_shape[-1]
    apply = tf.function(
        lambda codes: network.decoder(codes, training=False) * scale_m + mean_m,
        input_signature=[tf.TensorSpec((None, size), tf.float32)],
    )
    return lambda codes: apply(np.asarray(codes, np.float32)).numpy()
