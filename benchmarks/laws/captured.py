"""What registrations of scans have besides soft tissue: the captured-like form of the meshes.

    mesh_t = M(beta, theta_t) posed with (static_t + offsets_t), slid along its skin, with noise

`static_t`, in the rest pose, is part of the truth: a misfit that depends on the pose and that the
body model's blend shapes, which are linear in R - I, cannot follow, and a constant misfit of each
person. Sliding and noise belong to the registration, not to the body, and are no truth.
"""

from __future__ import annotations

import zlib

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.body.posing import joint_rotations
from bridge.body.surface_operators import vertex_areas_m2, vertex_normals
from bridge.motion import unpack_theta
from bridge.paper import N_JOINTS
from dsnet.synthetic.tissue_parameters import smooth_over_surface

Array = NDArray[np.floating]

# One misfit of pose for all runs: it stands for what every SMPL lacks.
_POSE_SEED = 20_210_901
_FIELDS_PER_JOINT = 3
# Root mean square of one field at its joint, and how fast it follows the rotation.
_POSE_FIELD_M, _POSE_GAIN = 0.0022, 3.0
# Lengths over which fields change, and how far from its joint the misfit of pose reaches.
_POSE_LENGTH_M, _PERSON_LENGTH_M, _SLIDE_LENGTH_M = 0.04, 0.07, 0.06
_POSE_REACH_M = 0.08
# Ranges, drawn per person or sequence, of root mean square lengths over vertices (and frames).
_PERSON_M, _NOISE_M, _SLIDE_M = (0.001, 0.003), (0.0003, 0.001), (0.001, 0.002)
_SLIDE_FIELDS = 4
_SLIDE_HZ = (0.1, 0.5)


class CapturedForm:
    """The misfits and the registration of one corpus.

    Parameters
    ----------
    data : body model.
    seed : of the people's misfits and of each sequence's noise and sliding.
    """

    def __init__(self, data: BodyModelData, seed: int) -> None:
        self._data, self._seed = data, seed
        self._areas = vertex_areas_m2(data.v_template, data.faces)
        # Any neighbour will do to turn with the skin: that of each vertex's last triangle.
        self._neighbours = np.zeros(len(data.v_template), int)
        for corner in range(3):
            self._neighbours[data.faces[:, corner]] = data.faces[:, (corner + 1) % 3]
        self._draw_pose_misfit()

    def static(self, subject: str, theta: Array) -> NDArray[np.float32]:
        """Misfit (T, V, 3) in the rest pose, metres, of a person in poses (T, 69)."""
        return (self.person_misfit(subject) + self.pose_misfit(theta)).astype(np.float32)

    def pose_misfit(self, theta: Array) -> Array:
        """(T, V, 3) sum over joints and fields of sin(a . (R - I) + b) - sin b times the field.

        Nothing in the rest pose; bounded; each joint's own rotation R decides alone.
        """
        rotations = joint_rotations(self._data, unpack_theta(theta)[0])[:, 1:N_JOINTS]
        bent = (rotations - np.eye(3)).reshape(len(theta), N_JOINTS - 1, 9)
        phase = np.einsum("tjx,jmx->tjm", bent, self._directions)
        strength = np.sin(phase + self._phases) - np.sin(self._phases)
        return np.tensordot(strength, self._pose_fields, axes=2)

    def person_misfit(self, subject: str) -> Array:
        """(V, 3) constant misfit of a person, which no betas and no rigid motion explain."""
        draw = self._drawn("person", subject)
        field = self._smooth_fields(draw, 1, _PERSON_LENGTH_M)[0]
        template = self._data.v_template
        shifts = [np.broadcast_to(axis, field.shape) for axis in np.eye(3)]
        turns = [np.cross(axis, template) for axis in np.eye(3)]
        basis = np.stack([*np.moveaxis(self._data.shapedirs, -1, 0), *shifts, *turns])
        flat = basis.reshape(len(basis), -1).T
        share, *_ = np.linalg.lstsq(flat, field.ravel(), rcond=None)
        rest = field - (flat @ share).reshape(field.shape)
        return draw.uniform(*_PERSON_M) * rest / _rms(rest)

    def registered(self, sequence: str, meshes: Array, fps: float) -> NDArray[np.float32]:
        """Meshes (T, V, 3) as a registration would find them: slid along the skin, and noisy."""
        noise = self._drawn("noise", sequence)
        scale_m = noise.uniform(*_NOISE_M) / np.sqrt(3)
        waves, fields = self._slide(sequence, len(meshes), fps)
        result = np.zeros(meshes.shape, np.float32)
        for frame, mesh in enumerate(meshes.astype(np.float64)):
            along = np.tensordot(waves[frame], fields, axes=1)
            sliding = np.einsum("vkx,vk->vx", self._tangents(mesh), along)
            result[frame] = mesh + sliding + scale_m * noise.standard_normal(mesh.shape)
        return result

    def _slide(self, sequence: str, length: int, fps: float) -> tuple[Array, Array]:
        """Slow sines in time (T, m), and the field (m, V, 2) along the tangents of each, metres."""
        draw = self._drawn("slide", sequence)
        fields = self._smooth_fields(draw, _SLIDE_FIELDS, _SLIDE_LENGTH_M)
        tangents = self._tangents(self._data.v_template)
        along = np.einsum("vkx,mvx->mvk", tangents, fields)
        along *= draw.uniform(*_SLIDE_M) / _rms(along)
        frequency, phase = draw.uniform(*_SLIDE_HZ, _SLIDE_FIELDS), draw.random(_SLIDE_FIELDS)
        times_s = np.arange(length)[:, None] / fps
        waves = np.sin(2 * np.pi * (frequency * times_s + phase))
        return waves * np.sqrt(2 / _SLIDE_FIELDS), along

    def _tangents(self, vertices: Array) -> Array:
        """(V, 2, 3) orthonormal vectors along the skin; the first follows an edge as it turns."""
        normals = vertex_normals(vertices, self._data.faces)
        edges = vertices[self._neighbours] - vertices
        edges -= (edges * normals).sum(1, keepdims=True) * normals
        edges /= np.linalg.norm(edges, axis=1, keepdims=True)
        return np.stack([edges, np.cross(normals, edges)], axis=1)

    def _draw_pose_misfit(self) -> None:
        """Fields (21, m, V, 3) about joints, and how the joints' rotations drive them."""
        data, draw, joints = self._data, np.random.default_rng(_POSE_SEED), N_JOINTS - 1
        directions = draw.standard_normal((joints, _FIELDS_PER_JOINT, 9))
        norms = np.linalg.norm(directions, axis=-1, keepdims=True)
        self._directions = _POSE_GAIN * directions / norms
        self._phases = draw.uniform(0, 2 * np.pi, (joints, _FIELDS_PER_JOINT))
        # Most where two segments share the skin equally, which is about their joint.
        parents = data.parents[1:N_JOINTS]
        near = data.weights[:, 1:N_JOINTS] * data.weights[:, parents]
        near = smooth_over_surface(near, data.v_template, data.faces, _POSE_REACH_M)
        near /= near.max(0)
        fields = self._smooth_fields(draw, joints * _FIELDS_PER_JOINT, _POSE_LENGTH_M)
        fields = fields.reshape(joints, _FIELDS_PER_JOINT, *fields.shape[1:])
        self._pose_fields = _POSE_FIELD_M * fields * near.T[:, None, :, None]

    def _smooth_fields(self, draw: np.random.Generator, count: int, length_m: float) -> Array:
        """(count, V, 3) random vector fields of root mean square length 1."""
        vertices, faces = self._data.v_template, self._data.faces
        # White noise on a surface has a variance of 1 / area in a vertex.
        white = draw.standard_normal((len(vertices), 3 * count)) / np.sqrt(self._areas)[:, None]
        smooth = smooth_over_surface(white, vertices, faces, length_m)
        smooth = smooth_over_surface(smooth, vertices, faces, length_m)
        fields = np.moveaxis(smooth.reshape(len(vertices), count, 3), 1, 0)
        return fields / _rms(fields)

    def _drawn(self, what: str, name: str) -> np.random.Generator:
        return np.random.default_rng([self._seed, zlib.crc32(f"{what} {name}".encode())])


def _rms(field: Array) -> Array:
    """Root mean square length of vectors (..., V, n) over the vertices: (..., 1, 1)."""
    return np.sqrt((field**2).sum(-1, keepdims=True).mean(-2, keepdims=True))
