"""From a pose sequence to the offsets of the second law: loads, tension of muscles, steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter
from scipy.spatial.transform import Rotation

from benchmarks.laws.second_tissue import Array, FleshLayer
from benchmarks.laws.second_tissue_parameters import layer_parameters, muscle_share
from bridge.body import BodyModelData
from bridge.body.posing import shaped_vertices
from bridge.motion import unpack_theta
from dsnet.synthetic.motions.plan import GRAVITY_M_S2
from dsnet.synthetic.simulation import skin

_LEAST_RATE_HZ = 120.0
_PARABOLA_FRAMES = 5
"""A parabola through as many frames tells the acceleration, less roughly than three would."""
# Angular acceleration and angle of a joint at which its muscles are at 63 % of their tension, and
# how long they take to get there.
_EFFORT_RAD_S2, _EFFORT_RAD = 120.0, 1.6
_MUSCLE_DELAY_S = 0.07


class SecondTissueSimulator:
    """The soft tissue of one subject under the second law.

    Parameters
    ----------
    body : body model.
    betas : (10,) shape of the subject.
    gravity : whether turned limbs hang.
    """

    def __init__(self, body: BodyModelData, betas: Array, *, gravity: bool = True) -> None:
        self.body, self.betas, self._gravity = body, betas, gravity
        self._vertices = shaped_vertices(body, betas[None])[0]
        self._parameters = layer_parameters(body, betas)
        self._layers: dict[float, FleshLayer] = {}

    def offsets(self, theta: Array, fps: float) -> NDArray[np.float32]:
        """Offsets (T, V, 3) in the rest pose, metres, of a motion (T, 69).

        Its first pose was held until the tissue had come to rest. Loads and tension change
        linearly from one frame to the next.
        """
        substeps = max(1, int(np.ceil(_LEAST_RATE_HZ / fps - 1e-9)))
        layer = self._layer(substeps * fps)
        loads = rest_frame_load(
            self.body,
            self.betas,
            theta,
            fps,
            layer.free,
            gravity=self._gravity,
        )
        tension = self._tension(theta, fps)[:, layer.free, None]
        result = np.zeros((len(theta), self.body.vertex_count, 3), np.float32)
        state = layer.settled(loads[0], tension[0])
        result[0, layer.free] = state.offsets_m
        for frame in range(1, len(theta)):
            for substep in range(substeps):
                first, second = (
                    _between(loads, frame, (substep + time) / substeps)
                    for time in layer.stage_times
                )
                tense = _between(tension, frame, (substep + 0.5) / substeps)
                state = layer.step(state, (first, second), tense)
            result[frame, layer.free] = state.offsets_m
        return result

    def _layer(self, rate_hz: float) -> FleshLayer:
        if rate_hz not in self._layers:
            self._layers[rate_hz] = FleshLayer(
                self._vertices, self.body.faces, self._parameters, rate_hz
            )
        return self._layers[rate_hz]

    def _tension(self, theta: Array, fps: float) -> Array:
        """(T, V) how many times as stiff as relaxed the flesh is.

        A segment's muscles work for the joint at its root and for those at its end.
        """
        slack = 1 - muscle_activation(theta, fps)
        idle = slack.copy()
        for joint in range(1, slack.shape[1]):
            idle[:, self.body.parents[joint]] *= slack[:, joint]
        gain = (self._parameters.greatest_tension - 1) * muscle_share(self.body)
        return 1 + gain * ((1 - idle) @ self.body.weights[:, : idle.shape[1]].T)


def muscle_activation(theta: Array, fps: float) -> Array:
    """(T, 22) in [0, 1): how much the muscles of each joint are tensed; the root has none.

    The effort 1 - exp(-|angular acceleration| / 120 rad/s^2 - (angle / 1.6 rad)^2) is followed
    with a delay of the first order.
    """
    rotations = Rotation.from_rotvec(unpack_theta(theta)[0].reshape(-1, 3))
    count = len(theta)
    angles = rotations.magnitude().reshape(count, -1)
    matrices = rotations.as_matrix().reshape(count, -1, 3, 3)
    turns = np.swapaxes(matrices[:-1], -1, -2) @ matrices[1:]
    speeds = Rotation.from_matrix(turns.reshape(-1, 3, 3)).as_rotvec()
    accelerations = np.zeros_like(angles)
    accelerations[1:-1] = (
        np.linalg.norm(np.diff(speeds.reshape(*turns.shape[:3]), axis=0), axis=-1) * fps**2
    )
    effort = 1 - np.exp(-accelerations / _EFFORT_RAD_S2 - (angles / _EFFORT_RAD) ** 2)
    effort[:, 0] = 0.0
    activation, kept = effort.copy(), np.exp(-1 / (fps * _MUSCLE_DELAY_S))
    for frame in range(1, count):
        activation[frame] = kept * activation[frame - 1] + (1 - kept) * effort[frame]
    return activation


def rest_frame_load(
    body: BodyModelData,
    betas: Array,
    theta: Array,
    fps: float,
    selected: NDArray[np.integer],
    *,
    gravity: bool = True,
) -> Array:
    """f = R^T (g - x'') - g (T, N, 3), m/s^2, of the `selected` vertices (N,).

    x'' is that of parabolas fitted to five frames. In the first frame the body is held: x'' is 0.
    """
    vertices, rotations = skin(body, betas, theta, selected)
    width = min(_PARABOLA_FRAMES, len(theta) - 1 + len(theta) % 2)
    acceleration = np.zeros_like(vertices)
    if width >= 3:
        acceleration = savgol_filter(vertices, width, 2, deriv=2, delta=1 / fps, axis=0)
    acceleration[0] = 0.0
    fall = np.array([0.0, -GRAVITY_M_S2 if gravity else 0.0, 0.0])[:, None]
    load = np.einsum("tyxn,tyn->txn", rotations, fall - acceleration) - fall
    return np.ascontiguousarray(load.transpose(0, 2, 1))


def _between(values: Array, frame: int, share: float) -> Array:
    return values[frame - 1] + share * (values[frame] - values[frame - 1])
