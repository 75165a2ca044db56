"""The reference as an engine: every operation in float64."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bridge.body import load_body_model
from bridge.exchange.layouts import AdamRule
from bridge.verify.protocol import Case, Tensors, serve
from bridge.verify.reference import adam, dsnet, mesh_autoencoder, smpl


def dsnet_forward(case: Case) -> Tensors:
    """Whole clips, or one frame at a time."""
    forward = dsnet.predict_by_frames if case.options["run"] == "steps" else dsnet.predict
    outputs = forward(case.weights(), case.inputs()["motion"])
    return {f"layer/{name}": outputs[name] for name in dsnet.LAYERS}


def dsnet_stream(case: Case) -> Tensors:
    """Latents of motions in their own units, from `scaling/...` beside the weights if there is."""
    w, motion = case.weights(), case.inputs()["motion"]
    if "scaling/input_mean" in w:
        motion = (motion - w["scaling/input_mean"]) / w["scaling/input_std"]
    latents = dsnet.predict_by_frames(w, motion)["fc_enc_3"]
    if "scaling/latent_mean" in w:
        latents = latents * w["scaling/latent_std"] + w["scaling/latent_mean"]
    return {"layer/latents": latents}


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
}

if __name__ == "__main__":
    serve(OPERATIONS, packages=("scipy",))
