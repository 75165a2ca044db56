"""The reference as an engine: every operation in float64."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bridge.body import load_body_model, pose_vertices
from bridge.exchange.weights import AdamRule
from bridge.motion import unpack_theta
from bridge.tissue.trained_plus import TrainedPlus
from bridge.verify.protocol import Case, Tensors, serve
from bridge.verify.reference import (
    adam,
    dsnet,
    mesh_autoencoder,
    oscillator_training,
    smpl,
    tissue,
)


def dsnet_forward(case: Case) -> Tensors:
    """Whole clips, or one frame at a time."""
    forward = dsnet.predict_by_frames if case.options["run"] == "steps" else dsnet.predict
    outputs = forward(case.weights(), case.inputs()["motion"])
    return {f"layer/{name}": outputs[name] for name in dsnet.LAYERS}


def dsnet_stream(case: Case) -> Tensors:
    """Latents of motions in their own units, from `scaling/...` beside the weights if there is."""
    return {"layer/latents": _latents(case.weights(), case.inputs()["motion"])}


def dsnet_train(case: Case) -> Tensors:
    """Layers in training mode, loss, gradients, steps of Adam."""
    given = case.inputs()
    real = given["real"] if case.options["masked"] else None
    batch = dsnet.Batch(given["motion"], given["latents"], real)
    outputs = dsnet.predict_in_training(case.weights(), batch)
    learned = adam.train(
        case.weights(), lambda weights: dsnet.learn(weights, batch), *_training_of(case)
    )
    return {**{f"layer/{name}": outputs[name] for name in dsnet.LAYERS}, **learned}


def ae_forward(case: Case) -> Tensors:
    """Encoder and decoder; from metres to metres when the case says so."""
    weights, given = case.weights(), case.inputs()
    if not case.options.get("metres"):
        outputs = mesh_autoencoder.run(weights, given["values"], _architecture(case))
        return _layers(outputs)
    mean_m, scale_m = weights.pop("normaliser.mean_m"), weights.pop("normaliser.scale_m")
    values = (given["offsets_m"] - mean_m) / scale_m
    outputs = mesh_autoencoder.run(weights, values, _architecture(case))
    restored = outputs["to_coordinates"] * scale_m + mean_m
    first = {"normaliser.normalise": values}
    return _layers({**first, **outputs, "normaliser.denormalise": restored})


def ae_train(case: Case) -> Tensors:
    """Loss, gradients, steps of Adam."""
    given, architecture = case.inputs(), _architecture(case)
    values, target = given["values"], given.get("target", given["values"])
    return adam.train(
        case.weights(),
        lambda weights: mesh_autoencoder.learn(weights, values, target, architecture),
        *_training_of(case),
    )


def posed_bodies(case: Case) -> Tensors:
    """SMPL forwards, unposing, and SMPL's gradient."""
    given = case.inputs()
    arguments = (given[name] for name in ("betas", "pose", "trans", "offsets"))
    bodies = smpl.Bodies(load_body_model(case.options["body"]), *arguments)
    slopes = smpl.gradient(bodies, given["probe"])
    gradients = {f"grad/{name}": array for name, array in slopes.items()}
    return {**_layers(smpl.forward(bodies, given["mesh"])), **gradients}


def dsnet_graph(case: Case) -> Tensors:
    """From poses to the posed skin, by DSNet and the decoder."""
    weights, given, body = case.weights(), case.inputs(), load_body_model(case.options["body"])
    theta, betas = given["theta"], given["betas"]
    joined = np.concatenate([np.broadcast_to(betas, (len(theta), *betas.shape)), theta], axis=-1)
    latents = _latents(weights, joined.swapaxes(0, 1)).swapaxes(0, 1)
    mean_m, scale_m = weights["normaliser.mean_m"], weights["normaliser.scale_m"]
    frames = []
    for pose, codes in zip(theta, latents, strict=True):
        values = mesh_autoencoder.decode(weights, codes, _architecture(case))
        posed = pose_vertices(body, betas, *unpack_theta(pose), values * scale_m + mean_m)
        frames.append(posed)
    return {"layer/vertices": np.stack(frames)}


def oscillators_train(case: Case) -> Tensors:
    """Offsets of windows, loss, gradients, steps of Adam."""
    weights, given = case.weights(), case.inputs()
    learned = adam.train(
        weights, lambda now: oscillator_training.learn(now, given), *_training_of(case)
    )
    return {"layer/offsets": oscillator_training.predict(weights, given), **learned}


def plus_graph(case: Case) -> Tensors:
    """From poses to the posed skin, by `dsnet_plus`."""
    model, given = TrainedPlus.from_arrays(case.weights()), case.inputs()
    body = load_body_model(case.options["body"])
    characters = zip(given["theta"].swapaxes(0, 1), given["betas"], strict=True)
    clips = [tissue.posed(model, body, theta, betas) for theta, betas in characters]
    return {"layer/vertices": np.stack(clips, axis=1)}


def _latents(w: Tensors, motion: np.ndarray) -> np.ndarray:
    """Of motions (B, T, 79) in their own units, frame by frame."""
    if "scaling/input_mean" in w:
        motion = (motion - w["scaling/input_mean"]) / w["scaling/input_std"]
    latents = dsnet.predict_by_frames(w, motion)["fc_enc_3"]
    if "scaling/latent_mean" in w:
        latents = latents * w["scaling/latent_std"] + w["scaling/latent_mean"]
    return latents


def _layers(outputs: Mapping[str, np.ndarray]) -> Tensors:
    return {f"layer/{name}": array for name, array in outputs.items()}


def _architecture(case: Case) -> mesh_autoencoder.Architecture:
    wanted = case.options["architecture"]
    return mesh_autoencoder.Architecture(
        len(wanted["widths"]) - 1, wanted["activation"], wanted["negative_slope"]
    )


def _training_of(case: Case) -> tuple[AdamRule, list[int]]:
    return AdamRule(**case.options["adam"]), case.options["steps"]


OPERATIONS = {
    "dsnet_forward": dsnet_forward,
    "dsnet_stream": dsnet_stream,
    "dsnet_train": dsnet_train,
    "ae_forward": ae_forward,
    "ae_train": ae_train,
    "smpl": posed_bodies,
    "oscillators_train": oscillators_train,
    "dsnet_graph": dsnet_graph,
    "plus_graph": plus_graph,
}

if __name__ == "__main__":
    serve(OPERATIONS, packages=("scipy",))
