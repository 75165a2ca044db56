"""SMPL in TensorFlow: forwards, backwards and undone."""

from __future__ import annotations

from bridge.body import load_body_model
from bridge.verify.answers import prefixed
from bridge.verify.protocol import Case, Tensors
from tf_dsnet.framework import tf
from tf_dsnet.smpl import KerasSMPL, unpose


def smpl(case: Case) -> Tensors:
    """Parts of the forward pass, the unposed mesh, and the gradient of sum(probe * vertices)."""
    given = {name: tf.constant(array) for name, array in case.inputs().items()}
    body = KerasSMPL(load_body_model(case.options["body"]), tf.as_dtype(case.dtype))
    motion = {name: given[name] for name in ("betas", "pose", "trans")}
    arguments = {**motion, "offsets": given["offsets"]}
    with tf.GradientTape() as tape:
        tape.watch(arguments)
        vertices = body(**arguments)
        total = tf.reduce_sum(given["probe"] * vertices)
    outputs = {
        "rotations": body.rotations(given["pose"]),
        "joints": body.joints(given["betas"]),
        "rest_vertices": body.rest_vertices(given["betas"], given["pose"]),
        "vertices": vertices,
        "unposed": unpose(body, given["mesh"], **motion),
    }
    return prefixed("layer", outputs) | prefixed("grad", tape.gradient(total, arguments))
