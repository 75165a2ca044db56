"""Fits of flesh to markers beside truth: the law that is rolled, one woman, and many people."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.skin_markers.truth import Flesh, flesh_model, packaged, write_recording
from bridge import DsnetError
from bridge.body import BodyModelData
from bridge.motion import Motion, load_motion
from bridge.motion.readers.amass import motion_path
from bridge.tissue.oscillators import coupling
from bridge.tissue.shape import shaped_normals
from bridge.tissue.trained_plus import TrainedPlus
from dsnet.fitting.fit import PEOPLE_SD, PRELOAD, Estimate, fit_subject
from dsnet.fitting.population import combine
from dsnet.fitting.recording import driving_load, liveliest, read_recording
from dsnet.fitting.tissue_patch import (
    Patch,
    Region,
    changed,
    constants_of,
    logit,
    logit_slope,
    preload_of,
    with_changes,
)
from dsnet.fitting.train import subjects_of
from dsnet.markers.registration import SOFT
from dsnet.prediction.controls import root_joint_m
from dsnet.prediction.load_model import load_model
from dsnet.prediction.models import PlusModel, codes_of
from tests.forged.c3d import c3d

BETAS = np.array([0.5, -0.4, 0.3, 0.2, -0.5, 0.1, 0.0, 0.3, -0.2, 0.1])
CHEST = Flesh(3.0, 0.26, 2.1)


@pytest.fixture(scope="module")
def body() -> BodyModelData:
    return load_model(None, None, "female").body


@pytest.fixture(scope="module")
def base(body: BodyModelData) -> TrainedPlus:
    """Flesh of the law's constants."""
    model = packaged("female")
    soft = {part: Flesh(3.6 if part == "chest" else 6.0, 0.22, 1.8) for part in SOFT}
    return flesh_model(body, model, soft)


@pytest.fixture(scope="module")
def jumping(body: BodyModelData) -> Motion:
    motion = load_motion(Path("sample:jumping_jacks"))
    return replace(motion, betas=BETAS).about_root_joint(root_joint_m(body, BETAS))


def test_what_a_fit_rolls_is_what_the_product_steps(
    body: BodyModelData, base: TrainedPlus, jumping: Motion
) -> None:
    model = flesh_model(body, base, {"chest": CHEST})
    nodes, her = model.nodes, constants_of(body, model, BETAS)
    codes = np.stack([*codes_of(PlusModel(model, body), jumping.theta.astype(np.float32), BETAS)])
    columns = {name: values[:, None] for name, values in her.items()}
    normals = shaped_normals(body, BETAS)[nodes.vertices].astype(np.float64)
    coupled = coupling(columns, nodes.laplacian)
    load = driving_load(model, body, replace(jumping, theta=np.asarray(jumping.theta, np.float64)))
    soft = Region.of(body, model, "chest").typical.argsort()[-10:]
    flesh = Patch(columns, coupled, normals, her["normal_ratio"])
    (rolled,) = flesh.simulate([load], [np.eye(len(nodes))[soft]])
    stepped = codes.transpose(0, 2, 1)[:, soft]
    assert np.ptp(stepped[..., 1]) > 0.05
    error = np.square(rolled[..., 0] - stepped).sum() / np.square(stepped).sum()
    assert error < 1e-5


def test_changes_are_of_the_region_alone(body: BodyModelData, base: TrainedPlus) -> None:
    region = Region.of(body, base, "chest")
    model = with_changes(body, base, {"chest": region}, {"chest": [0.3, -0.2, float(logit(2.2))]})
    before, after = (constants_of(body, one, np.zeros(10)) for one in (base, model))
    soft, far = region.softness > 0.9, region.softness == 0
    assert soft.sum() > 5
    np.testing.assert_allclose(
        np.log(after["omega"] / before["omega"]), 0.3 * region.softness, atol=1e-5
    )
    for name in ("omega", "damping_ratio", "stiffening", "sag", "wave_speed"):
        np.testing.assert_allclose(after[name][far], before[name][far], rtol=1e-5)
    whole = region.softness > 0.999
    hung = after["sag"] * after["omega"] ** 2 / 9.81
    np.testing.assert_allclose(hung[whole], 2.2, rtol=1e-3)


def test_preload_is_that_of_the_law(body: BodyModelData, base: TrainedPlus) -> None:
    """w^2 (1 + a |s|^2) s = g, with w^2 = W^2 / (1 + 3 a |s|^2)."""
    her = constants_of(body, base, np.zeros(10))
    normals = np.array([[1.0, 0.0, 0.0]]).repeat(len(her["omega"]), 0)
    sets = np.array([[0.1, 0.0, float(logit(p))] for p in (1.3, 2.0, 2.6)])
    found = changed(her, np.ones(len(normals)), normals, sets)
    strain, omega = found["stiffening"] * found["sag"] ** 2, found["omega"]
    np.testing.assert_allclose(
        omega**2 / (1 + 3 * strain) * (1 + strain) * found["sag"], 9.81, rtol=1e-6
    )
    np.testing.assert_allclose(preload_of(logit(np.array([1.3, 2.0, 2.6]))), [1.3, 2.0, 2.6])


def test_one_womans_chest_is_found_on_a_pose_that_swallowed_it(
    tmp_path: Path, body: BodyModelData, base: TrainedPlus, jumping: Motion
) -> None:
    true = flesh_model(body, base, {"chest": CHEST})
    bounce_m = write_recording(
        tmp_path / "jacks.npz", PlusModel(true, body), body, BETAS,
        np.asarray(jumping.theta[:130], np.float64), np.random.default_rng(3), swallows=True,
    )  # fmt: skip
    assert bounce_m > 0.04
    recording = read_recording(tmp_path / "jacks.npz", body)
    found = fit_subject(body, base, [recording])
    assert {"chest", "belly", "buttocks", "thighs", "calves"} == set(found)
    assert not found["chest"].doubt
    assert "indicative" in found["thighs"].doubt
    region, hers = Region.of(body, base, "chest"), constants_of(body, true, BETAS)
    truth = [
        region.typical @ np.log(hers["omega"] / (2 * np.pi)) - found["chest"].base[0],
        np.log(CHEST.damping_ratio) - found["chest"].base[1],
    ]
    off = np.abs(found["chest"].reach * np.array(found["chest"].found[:2]) - truth)
    assert off[0] < 0.06
    assert off[1] < 0.12
    assert found["chest"].left < 0.02
    shared = combine("chest", [found["chest"]])
    assert shared.told
    for name, true_value in (("damping_ratio", CHEST.damping_ratio), ("preload", CHEST.preload)):
        _, low, high = getattr(shared, name)
        assert low < true_value < high


def estimates(people: int, rng: np.random.Generator, mean: NDArray) -> list[Estimate]:
    """What people's markers would say whose changes are normal about a mean."""
    scale = np.array([1.0, 1.0, logit_slope(PRELOAD)])
    out = []
    for _ in range(people):
        own = mean + PEOPLE_SD * scale * rng.standard_normal(3)
        sd = scale * rng.uniform(0.02, 0.2, 3)
        said, information = own + sd * rng.standard_normal(3), np.diag(sd**-2.0)
        out.append(
            Estimate(said.tolist(), information.tolist(), (information @ said).tolist(),
                     [np.log(3.5), np.log(0.2)], 1.0, 10.0, 3, 0.1, "")
        )  # fmt: skip
    return out


def test_intervals_of_what_people_share_hold_the_truth() -> None:
    rng, held, off = np.random.default_rng(5), [], []
    for _ in range(60):
        mean = np.array([rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3), float(logit(1.8))])
        found = combine("chest", estimates(12, rng, mean))
        truth = (3.5 * np.exp(mean[0]), 0.2 * np.exp(mean[1]), 1.8)
        for name, value in zip(("frequency_hz", "damping_ratio", "preload"), truth, strict=True):
            _, low, high = getattr(found, name)
            held.append(low < value < high)
        off.append(found.frequency_hz[0] / truth[0] - 1)
    assert np.mean(held) > 0.85
    assert abs(np.mean(off)) < 0.02
    assert np.mean(np.abs(off)) < 0.08


def test_who_says_little_leaves_what_was_assumed() -> None:
    nothing = Estimate([0.5, 0.5, 0.0], (1e-3 * np.eye(3)).tolist(), [0.0, 0.0, 0.0],
                       [np.log(3.5), np.log(0.2)], 1.0, 3.0, 1, 1.0, "")  # fmt: skip
    found = combine("chest", [nothing])
    assert not found.told
    assert found.frequency_hz[0] == pytest.approx(3.5, rel=0.02)


def test_doubt_widens() -> None:
    sure = estimates(5, np.random.default_rng(0), np.array([0.0, 0.0, float(logit(1.8))]))
    doubted = [replace(one, doubt="indicative: on flesh") for one in sure]
    widths = [
        found.frequency_hz[2] - found.frequency_hz[1]
        for found in (combine("thighs", sure), combine("thighs", doubted))
    ]
    assert widths[1] > 1.2 * widths[0]


def test_the_liveliest_part_of_a_long_motion_is_fitted(jumping: Motion) -> None:
    still = np.repeat(jumping.theta[:1], 1200, 0)
    long = replace(
        jumping, theta=np.concatenate([still, jumping.theta, jumping.theta[-1:].repeat(600, 0)])
    )
    frames = liveliest(long)
    assert frames.start <= 1200 + 20
    assert frames.stop >= 1200 + len(jumping.theta) - 20
    assert frames.stop - frames.start <= 8 * 60


def test_a_recording_in_pieces_is_refused(
    tmp_path: Path, body: BodyModelData, base: TrainedPlus, jumping: Motion
) -> None:
    theta = np.array(jumping.theta, np.float64)
    write_recording(tmp_path / "cut.npz", PlusModel(base, body), body, BETAS, theta,
                    np.random.default_rng(0))  # fmt: skip
    stored = dict(np.load(tmp_path / "cut.npz"))
    for first in (80, 160):
        stored["trans"][first:, 0] += 3.0
        stored["marker_data"][first:, :, 0] += 3.0
    np.savez(tmp_path / "cut.npz", **stored)
    with pytest.raises(DsnetError, match="without a cut"):
        read_recording(tmp_path / "cut.npz", body)


def test_the_same_recording_counts_once(tmp_path: Path) -> None:
    with np.load(motion_path("sample:jumping_jacks")) as stored:
        pose = dict(stored)
    labels = [f"M{n}X" for n in range(5)]
    (tmp_path / "jacks.c3d").write_bytes(c3d(np.ones((3, 5, 3)), labels))
    np.savez(tmp_path / "jacks_poses.npz", **pose)
    np.savez(tmp_path / "jacks_stageii.npz", **{**pose, "betas": np.full(16, 0.3)})
    for name in ("one.npz", "two.npz"):
        np.savez(tmp_path / name, **pose, marker_data=np.ones((3, 5, 3)), marker_labels=labels)
    _, (person,), refused = subjects_of(tmp_path, None)
    assert [file.name for file in person.files] == ["jacks.c3d", "one.npz"]
    assert {Path(file).name: why for file, why in refused.items()} == dict.fromkeys(
        ("jacks_stageii.npz", "two.npz"), "the same recording again"
    )


def test_a_rate_at_which_nobody_falls_is_refused(
    tmp_path: Path, body: BodyModelData, base: TrainedPlus, jumping: Motion
) -> None:
    """AMASS's own sample says twice its rate: at that its flesh would seem four times as stiff."""
    theta = np.asarray(jumping.theta, np.float64)
    whole = np.concatenate([theta, theta[::-1]])
    write_recording(tmp_path / "a.npz", PlusModel(base, body), body, BETAS, whole,
                    np.random.default_rng(0))  # fmt: skip
    assert read_recording(tmp_path / "a.npz", body)
    stored: dict[str, Any] = dict(np.load(tmp_path / "a.npz"))
    stored["mocap_framerate"] = np.array(120.0)
    np.savez(tmp_path / "a.npz", **stored)
    with pytest.raises(DsnetError, match=r"times gravity at its 120 fps; expected its true rate"):
        read_recording(tmp_path / "a.npz", body)
