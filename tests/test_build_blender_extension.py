"""The extension's manifest names what lies in its zip, and its check notices what is off."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from tools.build_blender_extension import PLATFORMS, PYTHONS, manifest
from tools.try_blender_extension import REFUSED, judge

if sys.version_info < (3, 11):
    pytest.skip("tomllib comes with Python 3.11", allow_module_level=True)
import tomllib  # pyright: ignore[reportMissingImports]

LISTED = ("schema_version", "id", "version", "name", "tagline", "maintainer", "type", "license")
"""Fields that Blender asks of every manifest."""


@pytest.mark.parametrize("python", PYTHONS)
def test_the_manifest_is_filled_in(python: str) -> None:
    wheels = [Path("a/one-1-py3-none-any.whl"), Path("two-2-py3-none-any.whl")]
    told = tomllib.loads(manifest(wheels, [*PLATFORMS], python))
    assert told.keys() >= {*LISTED, "blender_version_min"}
    assert told["platforms"] == [*PLATFORMS]
    assert told["wheels"] == [f"./wheels/{wheel.name}" for wheel in wheels]
    assert len(told["tagline"]) <= 64
    assert all(len(why) <= 64 for why in told["permissions"].values())


@pytest.fixture
def truth() -> dict[str, np.ndarray]:
    rng, made = np.random.default_rng(2), {}
    for name in ("bvh", "glb"):
        alone, flesh = rng.normal(size=(2, 5, 9, 3))
        made |= {f"{name} {gain}": alone + 0.01 * gain * flesh for gain in (0, 1, 2)}
        made[f"{name} later"] = made[f"{name} 1"][3:]
    return made


@pytest.fixture
def seen(truth: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    found = {**truth, "refused": np.array(REFUSED), "glb before": truth["glb 0"]}
    for name in ("bvh", "glb"):
        found |= {f"{name} {what}": truth[f"{name} 1"] for what in ("later", "reopened")}
        found[f"{name} more objects"] = np.array(0)
    return found


def test_what_is_right_passes(seen, truth) -> None:
    off_mm, wrong = judge(seen, truth)
    assert wrong == []
    assert max(off_mm.values()) < 1e-9


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("bvh 1", lambda v: np.add(v, [2e-4, 0, 0])),
        ("bvh later", lambda v: v * np.nan),
        ("bvh more objects", lambda n: n + 1),
        ("glb 0", lambda v: np.add(v, [0, 2e-4, 0])),
        ("glb 2", lambda v: np.add(v, [0, 0, 3e-4])),
        ("glb reopened", lambda v: v[:, ::-1]),
        ("refused", lambda said: said[::-1]),
    ],
)
def test_what_is_off_is_noticed(name, change, seen, truth) -> None:
    _, wrong = judge({**seen, name: change(seen[name])}, truth)
    assert wrong
