"""What this side tells `dsnet plan`: its stages' settings, and the corpus that would be made."""

from __future__ import annotations

import json
from typing import Any

import pytest

from bridge.plan.request import PlanConfig, settings_of
from torch_align_ae.alignment import stage_align
from torch_align_ae.autoencoder import stage_train_ae
from torch_align_ae.corpus import stage_corpus
from torch_align_ae.plan import main


def told(capsys: pytest.CaptureFixture[str], config: PlanConfig) -> dict[str, Any]:
    main(config)
    return json.loads(capsys.readouterr().out)


@pytest.mark.parametrize("profile", ["smoke", "demo", "paper"])
def test_settings_are_the_profiles(capsys: pytest.CaptureFixture[str], profile: Any) -> None:
    settings = told(capsys, PlanConfig(profile=profile))["settings"]
    assert settings["truth"] == settings["corpus"]
    assert settings["corpus"] == settings_of(stage_corpus.PROFILES[profile])
    assert settings["train-ae"] == settings_of(stage_train_ae.PROFILES[profile])
    assert settings["align"]["steps"] == stage_align.PROFILES[profile].steps
    assert settings["align_robust"]["aligner"] == "robust"


def test_options_reach_the_stages(capsys: pytest.CaptureFixture[str]) -> None:
    config = PlanConfig(profile="smoke", seed=3, gender="male", aligner="robust")
    settings = told(capsys, config)["settings"]
    assert settings["corpus"]["seed"] == settings["train-ae"]["seed"] == 3
    assert settings["corpus"]["gender"] == "male"
    assert settings["align"]["aligner"] == "robust"
    assert "align_robust" not in settings


def test_the_papers_corpus_has_the_papers_size(capsys: pytest.CaptureFixture[str]) -> None:
    sequences = told(capsys, PlanConfig(profile="paper"))["sequences"]
    aligned = [one for one in sequences if one["split"] != "test"]
    assert len(aligned) == 67
    assert sum(one["length"] for one in aligned) == 21_502
    (held_out,) = [one["name"] for one in aligned if one["split"] == "validation"]
    assert held_out == "50004_one_leg_jump"
