"""Soft-tissue dynamics of SMPL bodies: from a motion to the moving skin of every vertex.

    import dsnet

    motion = dsnet.load_motion("walk.npz")     # AMASS, BVH and others, to 60 fps, y up
    moving = dsnet.animate(motion, gain=1.5)   # a body that performs it
    vertices_m, offsets_m = moving.arrays()    # (T, V, 3) metres: in the world, in the rest pose

Everything here is loaded when it is first used; no deep-learning framework is. Arrays are NumPy's,
units metres and radians, and what a user can do wrong is a `DsnetError` of one line.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from bridge import DsnetError, __version__

if TYPE_CHECKING:
    from bridge.body import load_body_model as load_body
    from bridge.body import pose_vertices
    from bridge.motion.resampling import load_motion
    from dsnet.exporters.export import export
    from dsnet.prediction.animate import animate, predict
    from dsnet.prediction.controls import Controls
    from dsnet.prediction.flesh import load_flesh
    from dsnet.prediction.load_model import load_model
    from dsnet.prediction.soft_tissue import soft_tissue
    from dsnet.stream.streams import Stream

__all__ = [
    "Controls",
    "DsnetError",
    "Stream",
    "__version__",
    "animate",
    "export",
    "load_body",
    "load_flesh",
    "load_model",
    "load_motion",
    "pose_vertices",
    "predict",
    "soft_tissue",
]
_LOADED_LATE = {
    "Controls": "dsnet.prediction.controls.Controls",
    "Stream": "dsnet.stream.streams.Stream",
    "animate": "dsnet.prediction.animate.animate",
    "export": "dsnet.exporters.export.export",
    "load_body": "bridge.body.load_body_model",
    "load_flesh": "dsnet.prediction.flesh.load_flesh",
    "load_model": "dsnet.prediction.load_model.load_model",
    "load_motion": "bridge.motion.resampling.load_motion",
    "pose_vertices": "bridge.body.pose_vertices",
    "predict": "dsnet.prediction.animate.predict",
    "soft_tissue": "dsnet.prediction.soft_tissue.soft_tissue",
}


def __getattr__(name: str) -> Any:
    if name in _LOADED_LATE:
        module, _, attribute = _LOADED_LATE[name].rpartition(".")
        return getattr(import_module(module), attribute)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
