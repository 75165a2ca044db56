"""`python -m tf_dsnet.verify`: results of Keras and TensorFlow for `dsnet verify`.

Operations and names are those of `bridge.exchange.engine`. They are computed by the networks,
trainer, learner and KerasSMPL that the product uses.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.body import load_body_model
from bridge.exchange.dsnet import Clips, TrainedDsnet
from bridge.exchange.engine import NORMALISER, Tensors, batches, joined, prefixed, serve, trained
from bridge.exchange.weights import mesh_autoencoder_from_keras
from tf_dsnet import keras_files, mesh_autoencoder, model
from tf_dsnet.clip_batches import ClipBatches
from tf_dsnet.framework import Tensor, keras, tf
from tf_dsnet.mesh_autoencoder import KerasMeshAutoencoder, TorchAdam
from tf_dsnet.oscillators import OscillatorLayer, OscillatorLearner
from tf_dsnet.smpl import KerasSMPL, unpose
from tf_dsnet.trainer import Trainer

Options = dict[str, Any]
LAYERS = ("fc_enc_1", "fc_enc_2", "lstm", "batch_norm", "fc_enc_3")


def dsnet_forward(weights: Tensors, motion: NDArray, run: str) -> Tensors:
    """Outputs of every layer in inference: the whole batch, row by row, or frame by frame."""
    network = _dsnet(weights)
    if run != "steps":
        traced = _traced(network)
        call = tf.function(lambda x: traced(x, training=False), reduce_retracing=True)
        return joined(_in_order(call(rows)) for rows in batches(motion, run))
    layer, frames = network.get_layer, []
    state = [tf.zeros((len(motion), layer("lstm").units), motion.dtype)] * 2
    for frame in motion.swapaxes(0, 1):  # the LSTM's state is passed from frame to frame
        first = layer("fc_enc_1")(frame)
        second = layer("fc_enc_2")(first)
        hidden, state = layer("lstm").cell(second, state)
        normalised = layer("batch_norm")(hidden[:, None], training=False)
        last = layer("fc_enc_3")(normalised)
        outputs = (first[:, None], second[:, None], hidden[:, None], normalised, last)
        frames.append(dict(zip(LAYERS, outputs, strict=True)))
    return joined(frames, axis=1)


def dsnet_train(weights: Tensors, masked: bool, steps: list[int], **arrays: NDArray) -> Tensors:
    """Layers, loss and gradients of a first training pass, and the training steps after it."""
    motion, real = arrays["motion"], arrays["real"]
    _compute_in(motion)
    clips = Clips(motion, arrays["latents"], real)
    trainer = Trainer(clips, lr=1e-4, batch_size=len(clips), masked=masked)
    network = trainer.model
    _exact(trainer.optimizer)
    epochs = iter(range(1, max(steps, default=0) + 1))

    def named(arrays: Sequence[NDArray]) -> Tensors:
        names = [name for name in model.named_weights(network) if "/moving_" not in name]
        return dict(zip(names, arrays, strict=True))

    # Every training pass changes the running statistics, so the weights are set again each time.
    model.assign_weights(network, weights)
    seen = _in_order(_traced(network)([motion, real] if masked else motion, training=True))
    model.assign_weights(network, weights)
    first_pass = trainer.gradients()
    model.assign_weights(network, weights)
    state = _state_of(trainer.optimizer, named, lambda: model.named_weights(network))
    learned = trained(steps, first_pass, lambda: trainer.epoch(next(epochs)), state)
    return prefixed("layer", seen) | learned


def dsnet_fit(weights: Tensors, steps: list[int], **arrays: NDArray) -> Tensors:
    """What training by Keras's own `compile` and `fit` leaves, with Keras's own LSTM."""
    network: Any = _dsnet(weights)
    clips = Clips(arrays["motion"], arrays["latents"], arrays["real"])
    data = ClipBatches(clips, batch_size=len(clips))
    network.compile(keras.optimizers.Adam(1e-4), model.SumOfDistances(), jit_compile=False)
    network.optimizer.build(network.trainable_variables)
    _exact(network.optimizer)

    def fit(epoch: int) -> float:
        options = {"shuffle": False, "verbose": 0, "callbacks": [data.in_order()]}
        history = network.fit(data, initial_epoch=epoch, epochs=epoch + 1, **options)
        return history.history["loss"][0]

    def named(arrays: Sequence[NDArray]) -> Tensors:
        names = [name for name in model.named_weights(network) if "/moving_" not in name]
        return dict(zip(names, arrays, strict=True))

    state = _state_of(network.optimizer, named, lambda: model.named_weights(network))
    epochs = iter(range(max(steps)))
    learned = trained(steps, (0.0, dict(weights)), lambda: fit(next(epochs)), state)
    return {name: a for name, a in learned.items() if name.startswith(("step_", "losses"))}


def dsnet_exported(weights: Tensors, motion: NDArray, form: str, saved: str = "") -> Tensors:
    """Latents (B, T, 100) of a `.keras` file or of what `dsnet export` makes of it.

    `form` is `keras`, `savedmodel` or `tflite`; without a file `saved` the network is saved first.
    """
    _compute_in(motion)
    with tempfile.TemporaryDirectory() as folder:
        path, made = Path(saved or f"{folder}/network.keras"), Path(folder, form)
        if not saved:
            network = keras_files.stock_network(TrainedDsnet.from_arrays("dsnet", weights))
            keras_files.save_keras(network, path)
        if form == "keras":
            opened: Any = keras.models.load_model(path)
            latents = opened(motion)
        elif form == "savedmodel":
            keras_files.write_savedmodel(made, path)
            served = tf.saved_model.load(made)  # held, as its function does not hold its weights
            latents = served.serve(motion)
        else:
            keras_files.write_tflite(made, path)
            runner = tf.lite.Interpreter(str(made)).get_signature_runner()
            latents = np.stack([_stepped(runner, clip) for clip in motion])
        return {"layer/latents": np.asarray(latents)}


def _stepped(runner: Any, clip: NDArray) -> NDArray:
    """Latents (T, 100) of a clip (T, 79), frame by frame."""
    shapes = {name: about["shape"] for name, about in runner.get_input_details().items()}
    states = {name: np.zeros(s, np.float32) for name, s in shapes.items() if name != "motion"}
    latents = []
    for frame in clip:
        states = runner(motion=frame[None], **states)
        latents.append(states.pop("latents")[0])
    return np.array(latents)


def ae_forward(weights: Tensors, values: NDArray, architecture: Options, run: str) -> Tensors:
    """Outputs of every layer, and of the normaliser if the weights contain one."""
    scaling = [weights.pop(name) for name in NORMALISER if name in weights]
    network = _autoencoder(weights, architecture)
    # Linear layers and nonlinearities; reshaping layers have no counterpart in other engines.
    encoder, decoder = (
        {n.name: n.output for n in side.layers if n.weights or n.name.endswith("_activation")}
        for side in (network.encoder, network.decoder)
    )
    encode = keras.Model(network.encoder.inputs, encoder)
    decode = keras.Model(network.decoder.inputs, decoder)

    def layers(rows: Tensor) -> dict[str, Tensor]:
        encoded = encode(rows)
        outputs = {**encoded, **decode(encoded["to_latent"])}
        # Features are last, except inside the convolutions.
        mixing = {name for name in outputs if ".conv_" in name}
        swapped = {name: tf.transpose(outputs[name], (0, 2, 1)) for name in mixing}
        return {name: {**outputs, **swapped}[name] for name in (*encoder, *decoder)}

    if not scaling:
        return joined(layers(rows) for rows in batches(values, run))
    mean_m, scale_m = scaling
    normalised = (values - mean_m) / scale_m
    outputs = {"normaliser.normalise": normalised, **layers(normalised)}
    outputs["normaliser.denormalise"] = outputs["to_coordinates"] * scale_m + mean_m
    return prefixed("layer", outputs)


def ae_train(
    weights: Tensors, values: NDArray, architecture: Options, steps: list[int], **target: NDArray
) -> Tensors:
    """Loss and gradients of reconstructing one batch, and training steps on it."""
    network = _autoencoder(weights, architecture).model
    inputs, expected = tf.constant(values), tf.constant(target.get("target", values))
    adam = TorchAdam()
    _exact(adam)

    def one_pass() -> tuple[float, list[Tensor]]:
        with tf.GradientTape() as tape:
            loss = tf.reduce_mean(tf.square(network(inputs) - expected))
        return float(loss), tape.gradient(loss, network.trainable_variables)

    def canonical(arrays: Sequence[NDArray]) -> Tensors:
        names = mesh_autoencoder.named_variables(network)
        return mesh_autoencoder_from_keras(dict(zip(names, arrays, strict=True)))

    def step() -> float:
        loss, gradients = one_pass()
        adam.apply(gradients, network.trainable_variables)
        return loss

    state = _state_of(adam, canonical, lambda: mesh_autoencoder.named_weights(network))
    loss, gradients = one_pass()
    return trained(steps, (loss, canonical([g.numpy() for g in gradients])), step, state)


def smpl(mesh: NDArray, probe: NDArray, body: str, **arguments: NDArray) -> Tensors:
    """Parts of the forward pass, the unposed mesh, and the gradients of sum(probe * vertices)."""
    given = {name: tf.constant(array) for name, array in arguments.items()}
    posed = KerasSMPL(load_body_model(body), given["pose"].dtype)
    with tf.GradientTape() as tape:
        tape.watch(given)
        vertices = posed(**given)
        total = tf.reduce_sum(probe * vertices)
    motion = {name: given[name] for name in ("betas", "pose", "trans")}
    outputs = {
        "rotations": posed.rotations(given["pose"]),
        "joints": posed.joints(given["betas"]),
        "rest_vertices": posed.rest_vertices(given["betas"], given["pose"]),
        "vertices": vertices,
        "unposed": unpose(posed, tf.constant(mesh), **motion),
    }
    return prefixed("layer", outputs) | prefixed("grad", tape.gradient(total, given))


def oscillators_train(
    weights: Tensors, steps: list[int], learning_rate: float, **windows: NDArray
) -> Tensors:
    """Offsets of windows, loss and gradients of a first pass, and the training steps after it."""
    _compute_in(windows["now"])
    laplacian = windows.pop("laplacian")
    layer = OscillatorLayer(laplacian, len(weights["residual"]), len(weights["taps"]))
    for variable in layer.weights:
        variable.assign(weights[variable.name])
    # Normalise again: unit vectors that were stored in float32 have eight digits.
    windows["normals"] /= np.linalg.norm(windows["normals"], axis=-1, keepdims=True)
    batch = {name: tf.constant(array) for name, array in windows.items()}
    learner = OscillatorLearner(layer, learning_rate)
    _exact(learner.optimizer)

    def named(arrays: Sequence[Any]) -> Tensors:
        names = [variable.name for variable in layer.trainable_variables]
        return {name: np.array(array) for name, array in zip(names, arrays, strict=True)}

    state = _state_of(learner.optimizer, named, lambda: named(layer.trainable_variables))
    offsets = learner.offsets(batch).numpy()
    loss, slopes = learner.gradients(batch)
    first_pass = float(loss), named(slopes)
    learned = trained(steps, first_pass, lambda: float(learner.step(batch)), state)
    return {"layer/offsets": offsets, **learned}


def _dsnet(weights: Tensors) -> keras.Model:
    _compute_in(weights["lstm/bias"])
    network = model.build_dsnet()
    model.assign_weights(network, weights)
    return network


def _autoencoder(weights: Tensors, architecture: Options) -> KerasMeshAutoencoder:
    _compute_in(weights["to_latent.bias"])
    network = KerasMeshAutoencoder(architecture["widths"])
    mesh_autoencoder.assign_weights(network.model, weights)
    return network


def _traced(network: keras.Model) -> keras.Model:
    return keras.Model(network.inputs, {n: network.get_layer(n).output for n in LAYERS})


def _in_order(outputs: dict[str, Tensor]) -> Tensors:
    return {name: outputs[name].numpy() for name in LAYERS}


def _state_of(
    adam: keras.optimizers.Adam,
    named: Callable[[Sequence[NDArray]], Tensors],
    weights: Callable[[], Tensors],
) -> Callable[[], dict[str, Tensors]]:
    """A function that gives weights and moments; `named` names arrays of trainable variables."""

    def moments(kind: str) -> Tensors:
        return named([v.numpy() for v in adam.variables if v.path.endswith(kind)])

    return lambda: {
        "weight": weights(), "adam_m": moments("_momentum"), "adam_v": moments("_velocity")
    }  # fmt: skip


def _compute_in(array: NDArray) -> None:
    """Build layers and optimizers in an array's precision from now on."""
    keras.config.set_floatx(array.dtype.name)
    # The first layer of a process fixes the policy, which a later floatx does not change.
    keras.config.set_dtype_policy(array.dtype.name)


def _exact(adam: keras.optimizers.Adam) -> None:
    """In float64, make Adam correct the bias of its moments with float64 decays.

    Keras converts its decays, which are Python floats, to float32 first: 1 - 0.999 is then off by
    1.3e-5, and so is every step.
    """
    if keras.config.floatx() == "float64":
        adam.beta_1, adam.beta_2 = np.float64(adam.beta_1), np.float64(adam.beta_2)


def here(engine: str) -> str:
    """Why there is no such engine here; the one that needs no GPU computes without."""
    if not engine.endswith("-gpu"):
        tf.config.set_visible_devices([], "GPU")
        return ""
    if not tf.config.list_physical_devices("GPU"):
        return "TensorFlow finds no GPU"
    tf.config.experimental.enable_tensor_float_32_execution(False)  # ten bits: no float32
    return ""


if __name__ == "__main__":
    operations = (
        dsnet_forward, dsnet_train, dsnet_fit, dsnet_exported, ae_forward, ae_train, smpl,
        oscillators_train,
    )  # fmt: skip
    serve(*operations, packages=("tensorflow", "keras"), here=here)
