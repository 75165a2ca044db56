"""DSNet changed one way at a time, each with the same care (Section 4.3 and what it leaves open).

The paper says of two that they were tried and not kept: the body's shape as the LSTM's initial
state by a network of radial basis functions, and more LSTM layers. The others ask what its inputs,
its latents and its padding are worth.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.systems.heading import heading_aligned
from benchmarks.systems.kinematics import pose_differences
from benchmarks.systems.loads import loads_on_skin
from benchmarks.systems.radial_basis import RadialBasis
from benchmarks.systems.searched import SearchedNetwork
from bridge.exchange.dsnet import Clips
from bridge.exchange.train_options import PredictorSettings
from bridge.paper import DSNET_WIDTHS, N_BETAS
from tf_dsnet.framework import Tensor, keras
from tf_dsnet.model import BlockLSTM
from tf_dsnet.predictors import BodyOf

Told = Callable[[NDArray, BodyOf], NDArray]


@dataclass(frozen=True)
class DsnetVariant(SearchedNetwork):
    """DSNet's layers, but for what is named."""

    of_motion: Told = lambda joined, _body: joined
    """From betas and theta (T, 79) to what it is told (T, I); the paper's is both."""
    lstm_layers: int = 1
    """Each followed by a batch normalisation (Section 5)."""
    batch_norm: bool = True
    """Whether one follows the LSTM."""
    past_frames: int | None = None
    """In place of the LSTM, a layer of as many units that sees so many frames before this one."""
    shape_as_state: bool = False
    """Betas give the LSTM's initial state and are not told at every frame."""
    change: str = ""
    """Where it leaves the paper, a clause; empty where it does not."""

    def told(self, joined: NDArray, body: BodyOf) -> NDArray:
        """What it is told, (T, I)."""
        return self.of_motion(joined, body)

    def departures(self, settings: PredictorSettings) -> tuple[str, ...]:
        """Where it leaves the paper."""
        return (*filter(None, [self.change]), *super().departures(settings))

    def build(self, *, input_size: int, masked: bool = False, people: int = 1) -> keras.Model:
        """The network, fresh."""
        units = DSNET_WIDTHS
        motion: Tensor = keras.Input((None, input_size), name="motion")
        real = keras.Input((None,), dtype="bool", name="real_frames") if masked else None
        state = _state_of_shape(motion, people) if self.shape_as_state else None
        hidden = motion[..., N_BETAS:] if self.shape_as_state else motion
        hidden = keras.layers.Dense(units["fc_enc_1"], name="fc_enc_1")(hidden)
        hidden = keras.layers.Dense(units["fc_enc_2"], activation="tanh", name="fc_enc_2")(hidden)
        for layer in range(self.lstm_layers):
            number = "" if layer == 0 else f"_{layer + 1}"
            if self.past_frames is None:
                lstm = BlockLSTM(units["lstm"], return_sequences=True, name=f"lstm{number}")
                hidden = lstm(hidden, initial_state=state if layer == 0 else None)
            else:
                window = keras.layers.Conv1D(
                    units["lstm"], self.past_frames + 1,
                    padding="causal", activation="tanh", name=f"window{number}",
                )  # fmt: skip
                hidden = window(hidden)
            if self.batch_norm:
                norm = keras.layers.BatchNormalization(name=f"batch_norm{number}")
                hidden = norm(hidden, mask=real)
        latents = keras.layers.Dense(units["fc_enc_3"], name="fc_enc_3")(hidden)
        return keras.Model([motion, real] if masked else motion, latents, name=self.name)

    def prepare(self, model: keras.Model, clips: Clips) -> None:
        """Put the radial basis functions on the training people."""
        if self.shape_as_state:
            people = np.unique(clips.inputs[:, 0, :N_BETAS], axis=0)
            model.get_layer("radial_basis").centre_on(people)

    def people_in(self, weights: Mapping[str, NDArray]) -> int:
        """How many people it was trained on, where its weights depend on that."""
        return len(weights["radial_basis/centres"]) if self.shape_as_state else 1


def _state_of_shape(motion: Tensor, people: int) -> list[Tensor]:
    """Hidden state and memory (B, 60) of the betas of each clip's first frame."""
    near = RadialBasis(people, name="radial_basis")(motion[:, 0, :N_BETAS])
    return [
        keras.layers.Dense(DSNET_WIDTHS["lstm"], name=name)(near)
        for name in ("initial_hidden", "initial_memory")
    ]


VARIANTS = (
    DsnetVariant("dsnet_searched", "DSNet, rate and epoch chosen", "autoencoder"),
    DsnetVariant("dsnet_pca", "DSNet on PCA latents"),
    DsnetVariant("dsnet_masked", "DSNet on PCA latents, masked", masked=True),
    DsnetVariant(
        "dsnet_no_betas", "DSNet on PCA latents, without betas",
        of_motion=lambda joined, _body: joined[:, N_BETAS:],
        change="is told no betas",
    ),
    DsnetVariant(
        "dsnet_rbf", "DSNet on PCA latents, betas as initial state",
        shape_as_state=True,
        change="betas give the LSTM's initial state, by Gaussians about the training people "
        "(Section 4.3; their number, width and the linear layer are ours)",
    ),
    DsnetVariant(
        "dsnet_two_lstm", "DSNet on PCA latents, 2 LSTM layers",
        lstm_layers=2, change="two LSTM layers (Section 4.3; 60 units each are ours)",
    ),
    DsnetVariant(
        "dsnet_three_lstm", "DSNet on PCA latents, 3 LSTM layers",
        lstm_layers=3, change="three LSTM layers (Section 4.3; 60 units each are ours)",
    ),
    DsnetVariant(
        "dsnet_no_batch_norm", "DSNet on PCA latents, without batch normalisation",
        batch_norm=False, change="no batch normalisation (Section 5)",
    ),
    DsnetVariant(
        "dsnet_two_frames", "DSNet on PCA latents, two past frames for the LSTM",
        past_frames=2,
        change="in place of the LSTM a tanh layer of 60 units that sees three frames (Section 4.2)",
    ),
    DsnetVariant(
        "dsnet_pca_differences", "DSNet on PCA latents, pose differences",
        of_motion=lambda joined, _body: pose_differences(joined),
        change="is told theta's first and second differences in place of theta",
    ),
    DsnetVariant(
        "dsnet_heading_aligned", "DSNet on PCA latents, place and heading taken out",
        of_motion=lambda joined, _body: heading_aligned(joined),
        change="is told the pose as of a body that faces ahead, and the root's step and turn since "
        "the last frame, in place of where it is and which way it faces",
    ),
    DsnetVariant(
        "dsnet_loads", "DSNet on PCA latents, loads",
        of_motion=loads_on_skin,
        change="is told betas and the inertia and gravity that act on the skin, not theta",
    ),
)  # fmt: skip
"""DSNet with its rate and epoch chosen, and changed in one way at a time."""
