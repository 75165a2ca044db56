"""Betas and the loads on the skin: what drives `dsnet_plus`, told to a network."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.systems.kinematics import CHANGE_S
from bridge.paper import FPS, N_BETAS
from bridge.tissue.nodes import farthest_points
from bridge.tissue.oscillators import node_loads
from tf_dsnet.predictors import BodyOf

NODES = 60
"""Few, for all of them are inputs: 6 numbers each."""


def loads_on_skin(joined: NDArray, body: BodyOf) -> NDArray:
    """Of betas and theta (T, 79): betas, inertia and gravity at 60 nodes, (T, 370).

    Accelerations are told as what they amount to in 0.1 s, metres, as differences of poses are.
    Inertia is a central difference, so a frame's is known one frame later, as `dsnet_plus` has it.
    """
    betas, theta = joined[0, :N_BETAS], joined[:, N_BETAS:]
    moved = body()
    vertices = farthest_points(np.asarray(moved.v_template, np.float64), NODES)
    load = node_loads(moved, vertices, betas, theta, FPS)
    parts = (joined[:, :N_BETAS], CHANGE_S**2 * load.inertia, CHANGE_S**2 * load.gravity)
    return np.concatenate([part.reshape(len(joined), -1) for part in parts], axis=1)
