"""Pictures for clips: quick, and without the grain of path tracing, which would flicker.

One lamp casts shadows; the light from all around is a glow of the surfaces themselves, more where
they look up. Nothing is drawn at random but the places of samples within a pixel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.report.render import (
    KEY_DIRECTION,
    Camera,
    camera_sensor,
    developed,
    floor_under,
    load_mitsuba,
    srgb_to_linear,
)

_SAMPLES = 4
_KEY, _GLOW, _GLOW_ABOVE, _FLOOR_GLOW = 2.2, 0.35, 0.2, 0.75


@dataclass(frozen=True, eq=False)
class PaintedBody:
    """A surface as it is drawn."""

    vertices_m: NDArray
    """(V, 3), metres, y up."""
    normals: NDArray
    """(V, 3), of unit length."""
    colours: NDArray
    """(V, 3) sRGB in [0, 1]."""


def render_clip_picture(
    bodies: Sequence[PaintedBody], faces: NDArray, camera: Camera
) -> NDArray[np.uint8]:
    """(height, width, 3) sRGB picture of bodies with the same faces (F, 3) on a white floor."""
    mi = load_mitsuba()
    floor = floor_under(mi, camera)
    floor["emitter"] = _glow({"type": "rgb", "value": _FLOOR_GLOW})
    scene = {
        "type": "scene",
        "integrator": {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0},
        "lamp": {
            "type": "directional",
            "direction": (-KEY_DIRECTION).tolist(),
            "irradiance": _KEY,
        },
        "camera": camera_sensor(mi, camera, _SAMPLES),
        "floor": floor,
    }
    scene |= {f"body_{index}": _mesh(mi, body, faces) for index, body in enumerate(bodies)}
    return developed(mi.render(mi.load_dict(scene), spp=_SAMPLES))


def _glow(radiance: dict[str, Any]) -> dict[str, Any]:
    # It is seen, but does not light others: looking for light on it would make grain.
    return {"type": "area", "radiance": radiance, "sampling_weight": 0.0}


def _mesh(mi: Any, body: PaintedBody, faces: NDArray) -> Any:
    properties, painted = mi.Properties(), srgb_to_linear(body.colours)
    reflectance = {"type": "mesh_attribute", "name": "vertex_color"}
    properties["bsdf"] = mi.load_dict({"type": "diffuse", "reflectance": reflectance})
    properties["emitter"] = mi.load_dict(_glow({"type": "mesh_attribute", "name": "vertex_glow"}))
    counts = len(body.vertices_m), len(faces)
    mesh = mi.Mesh("body", *counts, props=properties, has_vertex_normals=True)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = body.vertices_m.astype(np.float32).ravel()
    parameters["faces"] = faces.astype(np.uint32).ravel()
    parameters.update()
    glow = painted * (_GLOW + _GLOW_ABOVE * body.normals[:, 1:2])
    mesh.add_attribute("vertex_color", 3, painted.astype(np.float32).ravel())
    mesh.add_attribute("vertex_glow", 3, glow.astype(np.float32).ravel())
    return mesh
