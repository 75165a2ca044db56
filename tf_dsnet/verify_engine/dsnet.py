"""DSNet in Keras: every layer, and the product's trainer looked into."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bridge.exchange.dsnet import Clips
from bridge.verify.answers import joined, layers, learn, prefixed
from bridge.verify.protocol import Case, Tensors
from tf_dsnet.framework import Tensor, keras, tf
from tf_dsnet.model import assign_weights, build_dsnet, named_weights
from tf_dsnet.trainer import Trainer
from tf_dsnet.verify_engine.precision import compute_in, exact

LAYERS = ("fc_enc_1", "fc_enc_2", "lstm", "batch_norm", "fc_enc_3")


def forward(case: Case) -> Tensors:
    """Every layer at rest: the whole batch, row by row, or frame by frame."""
    model, motion = build(case), case.inputs()["motion"]
    if case.options["run"] == "steps":
        return joined(_frames(model, motion), axis=1)
    traced = _traced(model)
    run = tf.function(lambda x: traced(x, training=False), reduce_retracing=True)
    return layers(case, lambda x: _in_order(run(x)), motion)


def train(case: Case) -> Tensors:
    """Layers, loss and gradients of the first pass in training, and the steps after it."""
    learner = _DsnetLearner(case)
    return prefixed("layer", learner.layers()) | learn(case, learner)


def build(case: Case) -> keras.Model:
    """The product's network in the case's precision, with its weights."""
    compute_in(case.dtype)
    model = build_dsnet()
    assign_weights(model, case.weights())
    return model


class _DsnetLearner:
    def __init__(self, case: Case) -> None:
        compute_in(case.dtype)
        given, masked = case.inputs(), case.options["masked"]
        clips = Clips(given["motion"], given["latents"], given["real"])
        rate = case.options["adam"]["learning_rate"]
        self._trainer = Trainer(clips, lr=rate, batch_size=len(clips), masked=masked)
        exact(self._trainer.optimizer)
        self._inputs = [clips.inputs, clips.real] if masked else clips.inputs
        self._weights, self._epoch = case.weights(), 0
        self._begin()

    def layers(self) -> Tensors:
        seen = _traced(self._trainer.model)(self._inputs, training=True)
        self._begin()
        return _in_order(seen)

    def first_pass(self) -> tuple[float, Tensors]:
        found = self._trainer.gradients()
        self._begin()
        return found

    def step(self) -> float:
        self._epoch += 1
        return self._trainer.epoch(self._epoch)

    def state(self) -> dict[str, Tensors]:
        weights, state = named_weights(self._trainer.model), self._trainer.state()
        trained = [name for name in weights if "/moving_" not in name]
        moments = {
            kind: dict(zip(trained, (a for n, a in state.items() if n.endswith(end)), strict=True))
            for kind, end in (("adam_m", "_momentum"), ("adam_v", "_velocity"))
        }
        return {"weight": weights, **moments}

    def _begin(self) -> None:
        """Every pass in training moves the running statistics on: go back."""
        assign_weights(self._trainer.model, self._weights)


def _traced(model: keras.Model) -> keras.Model:
    return keras.Model(model.inputs, {name: model.get_layer(name).output for name in LAYERS})


def _in_order(outputs: dict[str, Tensor]) -> Tensors:
    return {name: outputs[name].numpy() for name in LAYERS}


def _frames(model: keras.Model, motion: np.ndarray) -> Iterator[Tensors]:
    """Every layer at one frame after another; the LSTM's cell is given its state by hand."""
    layer = model.get_layer
    state = [tf.zeros((len(motion), layer("lstm").units), motion.dtype)] * 2
    for frame in motion.swapaxes(0, 1):
        first = layer("fc_enc_1")(frame)
        second = layer("fc_enc_2")(first)
        hidden, state = layer("lstm").cell(second, state)
        normalised = layer("batch_norm")(hidden[:, None], training=False)
        last = layer("fc_enc_3")(normalised)
        outputs = (first[:, None], second[:, None], hidden[:, None], normalised, last)
        yield dict(zip(LAYERS, outputs, strict=True))
