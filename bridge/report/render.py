"""Path-traced pictures of posed bodies on a white floor; equal arguments give equal pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import gaussian_filter

CLAY_SRGB = (0.86, 0.79, 0.73)
_SKY, _KEY, _KEY_WIDTH_RAD = 0.4, 5.0, 0.3
_FLOOR_ALBEDO = 0.9
# The floor reflects light onto the bodies; without this, bright colours would burn out.
_BODY_EXPOSURE = 0.75
# With a pixel's own square about as wide as the renderer's Gaussian filter, 0.5 pixels.
_BLUR_PX = 0.4
KEY_DIRECTION = np.array([-0.5, 1.0, 0.75]) / np.linalg.norm([-0.5, 1.0, 0.75])
"""From the bodies to the lamp."""


@dataclass(frozen=True)
class Camera:
    """Where the pictures are taken from; one camera for all panels that are to be compared."""

    origin_m: tuple[float, float, float]
    """Position, metres."""
    target_m: tuple[float, float, float]
    """Point at the centre of the picture."""
    field_of_view_deg: float
    """Angle that the picture's width covers."""
    floor_m: float
    """Height of the floor, y up."""
    width_px: int
    """Width of the picture."""
    height_px: int
    """Height of the picture."""


def frame_camera(
    bodies: Sequence[ArrayLike],
    *,
    height_px: int,
    width_px: int | None = None,
    azimuth_deg: float = 20.0,
    elevation_deg: float = 8.0,
    margin: float = 0.04,
    floor_m: float | None = None,
) -> Camera:
    """A camera that sees all of `bodies` (each (V, 3), metres, y up).

    Parameters
    ----------
    width_px : chosen to fit the bodies when None.
    azimuth_deg : 0 looks along -z at the front of a body in its rest pose.
    margin : empty border, as a part of the picture.
    floor_m : the bodies' lowest point when None.
    """
    points = np.concatenate([np.asarray(body, dtype=np.float64) for body in bodies])
    floor = float(points[:, 1].min()) if floor_m is None else floor_m
    right, up, back = _camera_axes(np.radians(azimuth_deg), np.radians(elevation_deg))
    seen = points @ np.stack([right, up, back], axis=1)
    low, high = seen.min(axis=0), seen.max(axis=0)
    centre, half = (low + high) / 2, (high - low) / 2 * (1 + 2 * margin)
    if width_px is None:
        width_px = max(64, int(np.ceil(height_px * half[0] / half[1])))
    # A long lens: bodies at the ends of a row keep their shape.
    distance = 9.0 * max(half[1], half[0] * height_px / width_px) + half[2]
    nearest = distance - half[2]
    half_width = max(half[0], half[1] * width_px / height_px)
    target = centre @ np.stack([right, up, back])
    return Camera(
        origin_m=_triple(target + distance * back),
        target_m=_triple(target),
        field_of_view_deg=float(np.degrees(2 * np.arctan(half_width / nearest))),
        floor_m=floor,
        width_px=width_px,
        height_px=height_px,
    )


def render_bodies(
    bodies: Sequence[ArrayLike],
    faces: ArrayLike,
    *,
    camera: Camera,
    colours: Sequence[ArrayLike | None] | None = None,
    samples: int = 16,
    seed: int = 0,
) -> NDArray[np.uint8]:
    """Picture of bodies on a floor in soft light.

    Parameters
    ----------
    bodies : vertices of each body (V, 3), metres, world frame with y up.
    faces : (F, 3) vertex indices, counter-clockwise from outside.
    camera : see `frame_camera`.
    colours : sRGB colour in [0, 1] of each vertex (V, 3), for each body; clay where None.
    samples : light paths a pixel.

    Returns
    -------
    (height, width, 3) sRGB picture.
    """
    mi = load_mitsuba()
    painted = colours if colours is not None else [None] * len(bodies)
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 3, "hide_emitters": True},
        "light": {"type": "envmap", "bitmap": mi.Bitmap(_environment()), "scale": 1.0},
        "floor": floor_under(mi, camera),
        "camera": camera_sensor(mi, camera, samples),
    }
    for index, (body, colour) in enumerate(zip(bodies, painted, strict=True)):
        scene[f"body_{index}"] = _mesh(mi, np.asarray(body), np.asarray(faces), colour)
    return developed(mi.render(mi.load_dict(scene), spp=samples, seed=seed))


def developed(rendered: Any) -> NDArray[np.uint8]:
    """The (height, width, 3) sRGB picture of what the renderer gave, smoothed and on white paper.

    Smoothed here and not by the renderer: its threads would add to each other's pixels, in an order
    that differs from time to time.
    """
    pixels = gaussian_filter(np.array(rendered, dtype=np.float64), (_BLUR_PX, _BLUR_PX, 0))
    # Where no surface was hit there is white paper, like the unshaded floor.
    picture = linear_to_srgb(pixels[..., :3] + (1.0 - pixels[..., 3:4]))
    return np.round(255 * picture).astype(np.uint8)


def srgb_to_linear(colour: ArrayLike) -> NDArray[np.float64]:
    """Linear light of sRGB values in [0, 1]."""
    srgb = np.clip(np.asarray(colour, dtype=np.float64), 0.0, 1.0)
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(light: ArrayLike) -> NDArray[np.float64]:
    """The inverse of `srgb_to_linear`; light beyond [0, 1] is clipped."""
    linear = np.clip(np.asarray(light, dtype=np.float64), 0.0, 1.0)
    return np.where(linear <= 0.0031308, linear * 12.92, 1.055 * linear ** (1 / 2.4) - 0.055)


def load_mitsuba() -> Any:
    """The renderer's module, with the variant that needs no accelerator."""
    # Imported late: it takes half a second and chooses a variant for the whole process.
    import mitsuba as mi

    if mi.variant() is None:
        mi.set_variant("scalar_rgb")
    return mi


def _camera_axes(azimuth: float, elevation: float) -> tuple[NDArray, NDArray, NDArray]:
    """Right, up and backward directions of the camera in the world."""
    back = np.array(
        [
            np.sin(azimuth) * np.cos(elevation),
            np.sin(elevation),
            np.cos(azimuth) * np.cos(elevation),
        ]
    )
    right = np.array([np.cos(azimuth), 0.0, -np.sin(azimuth)])
    return right, np.cross(back, right), back


def _triple(vector: NDArray) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return x, y, z


def _environment(height: int = 64) -> NDArray[np.float32]:
    """Light from everywhere and a broad lamp: shadows are soft, and equal all over the floor."""
    polar = (np.arange(height) + 0.5) / height * np.pi
    around = (np.arange(2 * height) + 0.5) / height * np.pi
    sine = np.sin(polar)[:, None]
    # Mitsuba's environment: y up, and column u looks along (sin 2 pi u, cos v, -cos 2 pi u).
    direction = np.stack(
        np.broadcast_arrays(
            sine * np.sin(around), np.cos(polar)[:, None] + 0 * around, -sine * np.cos(around)
        ),
        axis=-1,
    )
    angle = np.arccos(np.clip(direction @ KEY_DIRECTION, -1, 1))
    light = _SKY + _KEY * np.exp(-0.5 * (angle / _KEY_WIDTH_RAD) ** 2)
    on_floor = np.clip(direction[..., 1], 0, None) * sine * (np.pi / height) ** 2
    # An unshaded floor is a shade brighter than the paper around the picture: both clip to white.
    light *= 1.08 * np.pi / (_FLOOR_ALBEDO * (light * on_floor).sum())
    return np.repeat(light[..., None], 3, axis=-1).astype(np.float32)


def floor_under(mi: Any, camera: Camera) -> dict[str, Any]:
    """A white floor that reaches out of every picture."""
    transform = mi.ScalarTransform4f
    placed = transform().translate([camera.target_m[0], camera.floor_m, camera.target_m[2]])
    return {
        "type": "rectangle",
        "to_world": placed @ transform().rotate([1, 0, 0], -90) @ transform().scale(60.0),
        "bsdf": {
            "type": "diffuse",
            "reflectance": {"type": "rgb", "value": _FLOOR_ALBEDO},
        },
    }


def camera_sensor(mi: Any, camera: Camera, samples: int) -> dict[str, Any]:
    """The renderer's description of a camera."""
    view = mi.ScalarTransform4f().look_at(camera.origin_m, camera.target_m, [0, 1, 0])
    return {
        "type": "perspective",
        "fov": camera.field_of_view_deg,
        "fov_axis": "x",
        "to_world": view,
        "film": {
            "type": "hdrfilm",
            "width": camera.width_px,
            "height": camera.height_px,
            "pixel_format": "rgba",
            "rfilter": {"type": "box"},
        },
        "sampler": {"type": "multijitter", "sample_count": samples},
    }


def _mesh(mi: Any, vertices: NDArray, faces: NDArray, colour: ArrayLike | None) -> Any:
    """A mesh with smooth normals and one colour a vertex."""
    painted = np.broadcast_to(
        np.asarray(CLAY_SRGB if colour is None else colour, dtype=np.float64), vertices.shape
    )
    painted_linear = _BODY_EXPOSURE * srgb_to_linear(painted)
    properties = mi.Properties()
    reflectance = {"type": "mesh_attribute", "name": "vertex_color"}
    properties["bsdf"] = mi.load_dict({"type": "diffuse", "reflectance": reflectance})
    mesh = mi.Mesh("body", len(vertices), len(faces), props=properties, has_vertex_normals=True)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = vertices.astype(np.float32).ravel()
    parameters["faces"] = faces.astype(np.uint32).ravel()
    parameters.update()
    mesh.add_attribute("vertex_color", 3, painted_linear.astype(np.float32).ravel())
    return mesh
