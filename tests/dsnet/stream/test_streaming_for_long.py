"""However long a stream goes on, it holds no more memory, and what it gives stays bounded."""

from __future__ import annotations

import gc
import os
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
import trimesh

from bridge.body import BodyModelData
from bridge.body.model_data import SMPL_PARENTS
from bridge.exchange.dsnet import TrainedDsnet
from dsnet.stream.streaming_predictor import StreamingPredictor
from dsnet.stream.streams import Stream
from tests.forged.plus import soft_flesh
from tests.forged.swaying import swaying

WARM_UP = 300
ALLOWED_BYTES = 40
"""A step. An array that were kept at each would be some hundred, however small."""


@pytest.fixture(scope="module")
def round_body() -> BodyModelData:
    """A ball of 162 vertices with all of SMPL's joints, for speed."""
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.5)
    rng, count = np.random.default_rng(0), len(ball.vertices)
    return BodyModelData(
        name="round",
        source="synthetic",
        gender="neutral",
        v_template=np.asarray(ball.vertices),
        shapedirs=rng.normal(scale=0.01, size=(count, 3, 10)),
        posedirs=rng.normal(scale=0.001, size=(count, 3, 207)),
        J_regressor=sp.csr_matrix(rng.dirichlet(np.ones(count), 24)),
        weights=rng.dirichlet(np.full(24, 0.1), count),
        faces=np.asarray(ball.faces),
        parents=np.array(SMPL_PARENTS),
    )


def growth_bytes(step: Callable[[int], None], steps: int, held: Callable[[], int]) -> int:
    """How much more is held after some steps than after the first."""
    for number in range(WARM_UP):
        step(number)
    before = held()
    for number in range(WARM_UP, WARM_UP + steps):
        step(number)
    return held() - before


def resident_bytes() -> int:
    """What the process holds."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


class Company:
    """A stream with somebody who stays, somebody who comes and goes, and cuts."""

    def __init__(self, body: BodyModelData, fps: float) -> None:
        self.bodies = Stream(soft_flesh(body, nodes=12), body=body, fps=fps)
        self.stays, self.guest = self.bodies.join(np.zeros(10)), self.bodies.join(np.ones(10))
        self.poses = swaying(np.arange(600) / fps)
        self.poses[:, 66] += 0.6 * (np.arange(600) // 200)
        self.largest_m = 0.0

    def step(self, number: int) -> None:
        if number % 100 == 0:
            self.bodies.leave(self.guest)
            self.guest = self.bodies.join(np.ones(10))
        pose = self.poses[number % 600]
        moved = self.bodies.step({self.stays: pose, self.guest: pose})
        sizes_m = [float(np.abs(body.offsets_m).max()) for body in moved.values()]
        self.largest_m = max(self.largest_m, *sizes_m)

    def held_bytes(self) -> int:
        """Of the characters."""
        return len(pickle.dumps(self.bodies._characters))


def test_bodies(round_body):
    company = Company(round_body, 90)
    assert growth_bytes(company.step, 1000, company.held_bytes) < 1000 * ALLOWED_BYTES
    assert 1e-3 < company.largest_m < 0.2


@pytest.mark.slow
def test_bodies_for_five_minutes(round_body):
    company = Company(round_body, 60)
    assert growth_bytes(company.step, 18_000, resident_bytes) < 18_000 * ALLOWED_BYTES
    assert 1e-3 < company.largest_m < 0.2


class Latents:
    """A stream of one character's latents."""

    def __init__(self, trained: TrainedDsnet) -> None:
        self.predictor = StreamingPredictor(trained)
        self.poses, self.betas = swaying(np.arange(600) / 60), np.zeros((1, 10))
        self.largest = 0.0

    def step(self, number: int) -> None:
        latents = self.predictor.step(self.poses[number % 600, None], self.betas)
        self.largest = max(self.largest, float(np.abs(latents).max()))

    def held_bytes(self) -> int:
        """Of what the network remembers."""
        return len(pickle.dumps(self.predictor._state))


@pytest.mark.parametrize("steps", [2_000, pytest.param(100_000, marks=pytest.mark.slow)])
def test_latents(trained, steps):
    stream = Latents(trained)
    assert growth_bytes(stream.step, steps, stream.held_bytes) < ALLOWED_BYTES
    assert 0.1 < stream.largest < 1e3
