"""`dyna_like`: a linear autoregression of the second order on principal components.

Source: Pons-Moll, Romero, Mahmood and Black, "Dyna: A Model of Dynamic Human Shape in Motion",
SIGGRAPH 2015. From its abstract: a second-order auto-regressive model in a low-dimensional linear
subspace, told earlier deformations, velocity and acceleration of the body, angular velocities and
accelerations of the limbs, and dependent on body mass index. DSNet's paper agrees (Sections 1, 2,
3.1, 4.2). What was not found there and is ours stands in `DynaLike.departures`; of the shape, which
is one number here because few people are trained on, `Autoregression` says how it enters.

`dyna_like_dmpl`: the same on the 8 directions that were released with DMPL (Loper, Mahmood, Romero,
Pons-Moll and Black, "SMPL", SIGGRAPH Asia 2015; AMASS uses them), of which no dynamics were.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.systems.autoregression import Autoregression, DrivenClip, OneStepFit
from benchmarks.systems.fitted_once import FitOutcome, FittedOnce
from benchmarks.systems.kinematics import KINEMATICS_SIZE, changes
from bridge.body.model_data import BodyModelData
from bridge.body.posing import shaped_vertices
from bridge.body.surface_operators import volume_m3
from bridge.errors import DsnetError
from bridge.exchange.dsnet import (
    DMPL,
    PCA,
    CodeName,
    Scaling,
    TrainedDsnet,
    UnpaddedClip,
    fit_scaling,
)
from bridge.exchange.train_options import PredictorSettings
from bridge.paper import DMPL_DIRECTIONS, LATENT_SIZE, N_BETAS
from dsnet.prediction.shapes import DENSITY_KG_M3
from tf_dsnet.predictors import BodyOf, PredictMotion, TrainingData

RIDGES = (1e-6, 1e-4, 1e-2, 3e-2, 1e-1, 3e-1, 1.0, 10.0)
"""Penalties of a frame that are tried, where inputs and latents have a spread of 1."""
_LAW, _BMI = "law", "bmi_kg_m2"


def body_mass_index(body: BodyModelData, betas: NDArray) -> float:
    """Mass by height squared, kg/m^2, of a person of shape betas (10,) in the rest pose."""
    vertices = shaped_vertices(body, np.asarray(betas, np.float64)[None])[0]
    return DENSITY_KG_M3 * volume_m3(vertices, body.faces) / float(np.ptp(vertices[:, 1])) ** 2


def _law_shape(size: int) -> tuple[int, int, int]:
    return (2, 2 * size + KINEMATICS_SIZE + 1, size)


@dataclass(frozen=True)
class DynaLike:
    """An entry of the registry."""

    name: str = "dyna_like"
    label: str = "Dyna-like, linear autoregression"
    code: CodeName = PCA
    size: int = LATENT_SIZE
    """Of the code."""

    def departures(self, settings: PredictorSettings) -> tuple[str, ...]:
        """Choices that are ours."""
        space = (
            "components of vertex offsets in the rest pose, as DMPL has them, in place of Dyna's "
            "of triangle deformations"
            if self.code == PCA
            else "DMPL's directions made orthonormal, about zero; its law was not released"
        )
        return (
            space,
            "138 inputs: the root's rates in its own frame, the joints' in theirs, by backward "
            "differences, each as what it amounts to in 0.1 s",
            "coefficients linear in the body mass index, of the mesh's volume and height, held "
            "to the range of the training people",
            f"ridge regression of one frame from two, by the ridge of {len(RIDGES)} with the "
            "least validation error on its own past; A1 and A2 damped alike if a mode would grow",
            "starts from the mean offset",
        )

    def training(
        self, settings: PredictorSettings, data: TrainingData, checkpoint: Path
    ) -> FittedOnce:
        """Begin training, or go on from `checkpoint` if that file is there."""
        fit = partial(fit_dyna, self.name, settings, data)
        return FittedOnce(self.name, fit, math.prod(_law_shape(self.size)), checkpoint)

    def load(self, arrays: Mapping[str, NDArray], body: BodyOf) -> PredictMotion:
        """A fitted law, applied to whole motions.

        Raises
        ------
        DsnetError
            If the arrays are another predictor's.
        """
        law = DynaLaw.from_arrays(self.name, arrays, self.size)
        return lambda theta, betas: law.latents(theta, body, betas)


@dataclass(frozen=True, eq=False)
class DynaLaw:
    """What has been fitted."""

    law: Autoregression
    """Of standardised features and latents."""
    scaling: Scaling
    """Of both."""
    known_bmi: NDArray[np.float64]
    """(P,) of the training people, kg/m^2."""

    @classmethod
    def from_arrays(
        cls, name: str, arrays: Mapping[str, NDArray], size: int = LATENT_SIZE
    ) -> DynaLaw:
        """The inverse of `arrays`, of a code of `size` numbers.

        Raises
        ------
        DsnetError
            If the arrays are another predictor's.
        """
        weights, bmi = (arrays.get(key, np.zeros(0)) for key in (_LAW, _BMI))
        if weights.shape != _law_shape(size) or bmi.ndim != 1 or not len(bmi):
            raise DsnetError(
                f"{name} of arrays {_LAW} {weights.shape} and {_BMI} {bmi.shape}",
                f"{_law_shape(size)} and one number for each training person",
                f"Pass {name}.safetensors as written by `dsnet train`.",
            )
        return cls(Autoregression(weights), TrainedDsnet.from_arrays(name, arrays).scaling, bmi)

    def arrays(self, name: str) -> dict[str, NDArray]:
        """What a file holds."""
        weights = {_LAW: self.law.weights, _BMI: self.known_bmi}
        return TrainedDsnet(name, weights, self.scaling).arrays()

    def latents(self, theta: NDArray, body: BodyOf, betas: NDArray) -> NDArray[np.float32]:
        """Latents (T, n) of a motion theta (T, 69) of a person of shape betas (10,)."""
        shape = standard_shape(body_mass_index(body(), betas), self.known_bmi)
        return self.scaling.restore(self.law.roll(self.scaling.inputs(changes(theta)), shape))


def dyna_like_dmpl() -> DynaLike:
    """The entry for DMPL's directions."""
    label = f"Dyna-like on DMPL's {DMPL_DIRECTIONS} directions"
    return DynaLike("dyna_like_dmpl", label, code=DMPL, size=DMPL_DIRECTIONS)


def standard_shape(bmi: float, known_bmi: NDArray) -> float:
    """A body mass index less the known people's mean, by their spread; held to their range."""
    held = np.clip(bmi, known_bmi.min(), known_bmi.max())
    return float((held - known_bmi.mean()) / (known_bmi.std() or 1.0))


def fit_law(
    train: Sequence[DrivenClip], validation: Sequence[DrivenClip]
) -> tuple[Autoregression, float]:
    """The law of the ridge that does best on its own past, and its validation loss."""
    fit = OneStepFit(train)
    shapes = [clip.shape for clip in train]
    low, high = min(shapes), max(shapes)
    laws = [fit.with_ridge(ridge).made_to_decay(low, high) for ridge in RIDGES]
    errors = [closed_loop_error(law, validation) for law in laws]
    best = int(np.argmin(errors))
    return laws[best], errors[best]


def closed_loop_error(law: Autoregression, clips: Sequence[DrivenClip]) -> float:
    """Distances between states and those that the law rolls to, summed over a clip's frames."""
    missed = (law.roll(clip.driver, clip.shape) - clip.state for clip in clips)
    return float(np.mean([np.linalg.norm(states, axis=1).sum() for states in missed]))


def fit_dyna(name: str, settings: PredictorSettings, data: TrainingData) -> FitOutcome:
    """Features, scaling and law of the training clips."""
    people = {clip.betas.tobytes(): clip.betas for clip in data.train}
    known = np.array([body_mass_index(data.body(), betas) for betas in people.values()])
    told = [_told(clip, settings.frames) for clip in data.train]
    scaling = fit_scaling(told, settings.min_input_std)

    def driven(clip: UnpaddedClip) -> DrivenClip:
        shape = standard_shape(body_mass_index(data.body(), clip.betas), known)
        seen = _told(clip, settings.frames)
        return DrivenClip(scaling.inputs(seen.inputs), scaling.latents(seen.latents), shape)

    train, validation = ([driven(clip) for clip in part] for part in (data.train, data.validation))
    law, validation_loss = fit_law(train, validation)
    arrays = DynaLaw(law, scaling, known).arrays(name)
    return FitOutcome(arrays, closed_loop_error(law, train), validation_loss)


def _told(clip: UnpaddedClip, frames: int) -> UnpaddedClip:
    """The features and latents of the frames that every predictor is trained on."""
    return UnpaddedClip(changes(clip.inputs[:frames, N_BETAS:]), clip.latents[:frames])
