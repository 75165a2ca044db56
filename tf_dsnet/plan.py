"""`python -m tf_dsnet.plan`: the settings of this side's stages as JSON."""

from __future__ import annotations

import json
import sys
from dataclasses import replace

from bridge.plan.request import PlanConfig, seeded, settings_of
from bridge.runs.processes import run_as_process
from tf_dsnet import stage_predict, stage_predict_plus, stage_train, stage_train_plus


def main(config: PlanConfig) -> None:
    """Print what stages of this profile would be given; nothing is made."""
    amass = {"amass": config.amass, "amass_fps": config.amass_fps}
    stages = {
        stage_train.STAGE: seeded(stage_train.PROFILES[config.profile], config.seed),
        stage_train_plus.STAGE: seeded(stage_train_plus.PROFILES[config.profile], config.seed),
        stage_predict.STAGE: replace(stage_predict.PROFILES[config.profile], **amass),
        stage_predict_plus.STAGE: replace(stage_predict_plus.PROFILES[config.profile], **amass),
    }
    settings = {name: settings_of(own) for name, own in stages.items()}
    sys.stdout.write(json.dumps({"settings": settings}))


if __name__ == "__main__":
    run_as_process(PlanConfig, main)
