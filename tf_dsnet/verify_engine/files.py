"""Weights through memory and through every file that Keras's side can write."""

from __future__ import annotations

from bridge.exchange import load_weights, save_weights
from bridge.verify.answers import prefixed
from bridge.verify.protocol import Case, Tensors
from tf_dsnet import mesh_autoencoder, model
from tf_dsnet.framework import keras
from tf_dsnet.verify_engine import dsnet
from tf_dsnet.verify_engine import mesh_autoencoder as autoencoder


def formats(case: Case) -> Tensors:
    """Read back what was assigned, and what a fresh network was given by each file."""
    if case.options["network"] == "dsnet":
        module, first, second = model, dsnet.build(case), model.build_dsnet()
    else:
        module, first = mesh_autoencoder, autoencoder.build(case, case.weights()).model
        second = mesh_autoencoder.KerasMeshAutoencoder(**case.options["architecture"]).model
    save_weights(case.scratch / "weights.safetensors", module.named_weights(first))
    module.assign_weights(second, load_weights(case.scratch / "weights.safetensors"))
    first.save(case.scratch / "network.keras")
    third = keras.saving.load_model(case.scratch / "network.keras", compile=False, safe_mode=True)
    read = {"memory": first, "safetensors": second, "keras": third}
    kept: Tensors = {}
    for name, network in read.items():
        kept |= prefixed(f"weight/{name}", module.named_weights(network))
    return kept
