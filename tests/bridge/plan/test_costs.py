"""The work of each stage, counted by hand for three short sequences."""

from __future__ import annotations

import pytest

from bridge.motion import MotionSequence
from bridge.plan.costs import MESH_BYTES, Material, Work, rate_name, works
from bridge.plan.rates import RATES

SGD = {"aligner": "sgd", "steps": 10, "first_frame_steps": 100, "shape_steps": 1000}
TRAIN_AE = {
    "include_held_out": False,
    "batch_size": 7,
    "steps": 0,
    "epochs": 3,
    "comparisons": ["literal"],
    "comparison_epochs": 1,
    "validate_every": 0,
    "validation_frames": 0,
}
PLUS = {"rounds": 2, "steps": 5, "batch_size": 4, "window": 6, "nodes": 10, "static": True}
SETTINGS = {
    "truth": {"form": "clean"},
    "corpus": {"form": "clean"},
    "align": SGD,
    "align_robust": {"aligner": "robust"},
    "train-ae": TRAIN_AE,
    "encode": {},
    "train": {"epochs": 50, "predictors": ["one", "other"]},
    "train_plus": PLUS,
    "predict": {},
    "predict_plus": {},
    "decode": {},
    "evaluate": {},
    "report": {"panel_px": 10},
}


def sequence(name: str, length: int, split: str) -> MotionSequence:
    return MotionSequence(name, name[0], name[2:], 0, length, 60.0, split)  # type: ignore[arg-type]


MATERIAL = Material(
    [
        sequence("a_hop", 30, "train"),
        sequence("a_run", 10, "validation"),
        sequence("b_run", 20, "train"),
        sequence("b_hop", 50, "train"),
        sequence("c_run", 40, "test"),
    ]
)


@pytest.fixture
def found() -> dict[str, Work]:
    return works(SETTINGS, MATERIAL)


def test_amounts(found: dict[str, Work]) -> None:
    epochs = 3 * 10 * 7 + 4 * 30 / 3  # 70 of 100 frames; four validations of the other 30
    comparison = 1 * 10 * 7 + 2 * 30 / 3
    assert {name: work.amount for name, work in found.items()} == pytest.approx(
        {
            "truth": 150,
            "corpus": 110,
            "align": 10 * 106 + 100 * 4 + 1000 * 2,
            "align_robust": 110,
            "train-ae": epochs + comparison,
            "encode": 110,
            "train": 50 * 3 * 2,
            "train_plus": 2 * (5 * 4 * 6 + 100 / 3) * 10,
            "predict": 150 * 2,
            "predict_plus": 100,  # all but the second of b's
            "decode": 100 * 3,
            "evaluate": 100 * 3,
            "report": 100,
        }
    )


def test_disk(found: dict[str, Work]) -> None:
    meshes = {name: work.disk_bytes / MESH_BYTES for name, work in found.items()}
    assert meshes["truth"] == 150
    assert meshes["corpus"] == meshes["align"] == meshes["align_robust"] == 110
    assert meshes["predict_plus"] == 200
    assert meshes["decode"] == 300
    captured = works({"truth": {"form": "captured"}}, MATERIAL)["truth"]
    assert captured.disk_bytes == 300 * MESH_BYTES
    # The autoencoder, and a hundred principal components.
    assert found["train-ae"].disk_bytes == 4 * 33_626_606 + 100 * MESH_BYTES
    assert found["encode"].disk_bytes == 110 * 4 * (100 + 100 + 69)
    assert found["train-ae"].scratch_bytes > 4 * found["train-ae"].disk_bytes


def test_mapped_files(found: dict[str, Work]) -> None:
    meshes = {name: work.mapped_bytes / MESH_BYTES for name, work in found.items()}
    assert meshes["truth"] == meshes["corpus"] == 150
    assert meshes["train-ae"] == meshes["encode"] == meshes["train_plus"] == 110
    assert meshes["decode"] == 300
    assert meshes["evaluate"] == 0


def test_as_many_steps_as_are_asked_for() -> None:
    asked = {"steps": 12, "comparisons": [], "validate_every": 5, "validation_frames": 9}
    work = works({"train-ae": TRAIN_AE | asked}, MATERIAL)["train-ae"]
    assert work.amount == pytest.approx(12 * 7 + (1 + 3) * 9 / 3)


def test_a_training_that_is_stopped_costs_what_it_has_done() -> None:
    work = works({"train-ae": TRAIN_AE | {"stop_epoch": 2}}, MATERIAL)["train-ae"]
    assert work.text == "20 steps of 7, literal 10"  # of 30


def test_the_paper_draws_from_the_held_out_sequence_too() -> None:
    work = works({"train-ae": TRAIN_AE | {"include_held_out": True}}, MATERIAL)["train-ae"]
    assert work.text == "33 steps of 7, literal 11"  # 77 of 110 frames


def test_every_stage_has_a_measured_rate() -> None:
    assert set(RATES) == set(SETTINGS)
    assert all(rate.seconds > 0 and rate.amount > 0 for rate in RATES.values())


def test_the_robust_aligner_keeps_its_rate_in_the_papers_place() -> None:
    settings = {"align": {"aligner": "robust"}}
    assert rate_name("align", settings) == "align_robust"
    assert works(settings, MATERIAL)["align"].amount == 110
    assert rate_name("align", SETTINGS) == "align"
