"""`python -m benchmarks.prediction.lesser_plus`: `dsnet_plus` without one of its parts."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.processes import run_as_process
from bridge.exchange.train_options import TrainPlusConfig
from bridge.tissue.trained_plus import NODE_FIELDS, Weights
from dsnet.prediction.models import simulate_nodes
from dsnet.stages import stage_train
from tf_dsnet.oscillators import OscillatorLayer
from tf_dsnet.train_plus import PlusTraining, train_plus

_NOTHING = dict.fromkeys(NODE_FIELDS, 1e-6) | {"normal_ratio": 1.0}
"""What a coefficient that is left out is held at: it does nothing."""


@dataclass(frozen=True)
class PartsOfPlus:
    """What may be left out."""

    gravity: bool = True
    """Gravity among the loads."""
    coupling: bool = True
    """Neighbouring nodes pull at each other."""
    bending: bool = True
    """The skin resists bending, besides being under tension."""
    stiffening: bool = True
    """Springs stiffen as they are stretched."""
    sag: bool = True
    """They stiffen about the shape without weight, not about the standing one."""
    anisotropy: bool = True
    """Springs are stiffer along the skin's normal, or softer, than along the skin."""
    by_shape: bool = True
    """The body's shape tells how soft it is where; without, new people are like known ones."""
    through_time: bool = True
    """Two thirds of the rounds start from the model's own past, not from the data's."""
    static: bool = True
    """Learn a constant and a smooth function of the pose besides, where it helps."""

    @property
    def held(self) -> tuple[str, ...]:
        """Coefficients that are left out."""
        parts = {
            "gravity_gain": self.gravity,
            "wave_speed": self.coupling,
            "bending": self.coupling and self.bending,
            "stiffening": self.stiffening,
            "sag": self.sag,
            "normal_ratio": self.anisotropy,
        }
        return tuple(name for name, wanted in parts.items() if not wanted)


@dataclass(frozen=True)
class LesserPlusConfig(PartsOfPlus):
    """Train `dsnet_plus` of a run without some of its parts, in the place of the whole one."""

    run: str = "demo"
    """Run whose aligned offsets are learned."""
    profile: str = "demo"
    """Sizes: smoke, demo or paper."""
    seed: int = 0
    """Seed of the windows' order."""
    nodes: int | None = None
    """Vertices that carry the tissue; the profile's when left out, as those below."""
    rounds: int | None = None
    """Rounds of training."""
    look_ahead: int | None = None
    """Frames by which the newest load lies ahead of the step."""


@dataclass(frozen=True)
class _LesserStage(TrainPlusConfig, PartsOfPlus):
    """What the manifest says of its settings."""


class LesserTraining(PlusTraining):
    """A training that leaves out what `_LesserStage` says."""

    settings: _LesserStage

    def make_layer(self) -> OscillatorLayer:
        """The oscillators, of which some coefficients are held where they do nothing."""
        layer = super().make_layer()
        weights = {weight.name: weight for weight in layer.weights}
        held = [] if self.settings.by_shape else ["slopes", "stiffening_power"]
        for name in self.settings.held:
            weights[f"log_{name}"].assign([np.log(_NOTHING[name])])
            held += [f"log_{name}", f"by_node_{name}"]
        for name in held:
            weights[name].trainable = False
        return layer

    def explained_by_shape(self, weights: Weights) -> Weights:
        """Leave the weights as learned if shape is not to explain them."""
        return super().explained_by_shape(weights) if self.settings.by_shape else weights

    def starts(self, number: int, dynamic: list[NDArray]) -> list[NDArray]:
        """From the data in every round, if they do not learn through time."""
        return super().starts(number, dynamic) if self.settings.through_time else dynamic

    def static_rounds(self) -> set[int]:
        """None without a static part."""
        return super().static_rounds() if self.settings.static else set()


def main(config: LesserPlusConfig) -> None:
    """Train it so."""
    whole = stage_train.plus_config(stage_train.PROFILES[config.profile])
    given = {name: value for name, value in asdict(config).items() if value is not None}
    options = {**asdict(whole), **given}
    del options["profile"]
    train_plus(_LesserStage(**options), simulate_nodes, LesserTraining)


if __name__ == "__main__":
    run_as_process(LesserPlusConfig, main)
