"""A run of one person and two motions, of which one's truth is known, and flesh that moves."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import pytest

from bridge.body import load_body_model
from bridge.runs import ArtifactWriter, Run
from bridge.tissue.trained_plus import TrainedPlus
from tests.forged.plus import soft_flesh, write_plus
from tools.headless_chromium import chromium

if TYPE_CHECKING:
    from playwright.sync_api import Browser

BODY, FRAMES = "embedded:female", 80
JUMP = "50004_jump (held out)"


def jump(frames: int) -> np.ndarray:
    """(T, 69) up and down twice a second, with the arms at rest."""
    theta = np.zeros((frames, 69), np.float32)
    theta[:, 67] = 0.2 * np.abs(np.sin(2 * np.pi * np.arange(frames) / 30))
    return theta


def sequence(motion: str, start: int, split: str) -> dict:
    place = {"start": start, "length": FRAMES, "fps": 60.0}
    return {
        "name": f"50004_{motion}",
        "subject": "50004",
        "motion": motion,
        "split": split,
        **place,
    }


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Chromium; tests that take it skip where there is none."""
    with chromium() as found:
        yield found


@pytest.fixture(scope="session")
def flesh() -> TrainedPlus:
    return soft_flesh(load_body_model(BODY))


@pytest.fixture(scope="package")
def run(tmp_path_factory, flesh) -> Iterator[Run]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DSNET_RUNS", str(tmp_path_factory.mktemp("runs")))
        yield forged_run(flesh)


def forged_run(flesh: TrainedPlus) -> Run:
    run, betas = Run("r"), np.array([[0.5, -0.5, *np.zeros(8)]], np.float32)
    align = ArtifactWriter(run.path / "align", "align", data="synthetic")
    align.put("theta", np.concatenate([jump(FRAMES), np.zeros((FRAMES, 69), np.float32)]), "rad, m")
    align.put("betas", betas, "1")
    align.record(sequences=[sequence("jump", 0, "validation"), sequence("stand", FRAMES, "train")])
    align.finish(config={"smpl": BODY})
    truth = ArtifactWriter(run.path / "truth", "truth", data="synthetic")
    truth.put("theta", jump(FRAMES - 10), "rad, m")
    truth.put("betas", betas, "1")
    truth.put("offsets", np.full((FRAMES - 10, 6890, 3), 0.01, np.float32), "m")
    truth.record(sequences=[sequence("jump", 0, "validation") | {"length": FRAMES - 10}])
    truth.finish()
    write_plus(run, flesh)
    return run
