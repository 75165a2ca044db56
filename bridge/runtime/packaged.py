"""The small trained models that come with the package, so that a motion moves without training.

Each is an artifact like a stage's: `dsnet_plus` of the synthetic corpus, for the embedded body of
one gender. `python tools/build_packaged_models.py` makes them.
"""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from bridge.body.embedded import EMBEDDED_GENDERS, EMBEDDED_PREFIX
from bridge.errors import DsnetError, did_you_mean
from bridge.runs import read_artifact
from bridge.runtime.motion_predictor import Chosen
from bridge.runtime.plus_step import PLUS

KIND = "packaged-model"
OWNER = "the packaged model"


def packaged_folder(gender: str) -> Path:
    """Where the model of `female` or `male` bodies lies."""
    return Path(str(resources.files("bridge.runtime"))) / "models" / gender


def packaged_predictor(gender: str, asked: str | None = None) -> Chosen:
    """The packaged predictor of bodies of one gender; `female` where it is neither.

    Raises
    ------
    DsnetError
        If `asked` names another predictor than the one that is packaged.
    """
    gender = gender if gender in EMBEDDED_GENDERS else EMBEDDED_GENDERS[0]
    model = read_artifact(packaged_folder(gender), KIND)
    (name, entry), *_ = model.manifest["predictors"].items()
    if asked not in (None, name):
        raise DsnetError(
            f"predictor {asked!r} without a run",
            f"{name}, which comes with the package",
            did_you_mean(
                asked or "",
                [name],
                "Train another and name its run: ./reproduce.sh, then --run demo.",
            ),
        )
    owner, body_model = f"{OWNER} ({gender}, {model.origin})", EMBEDDED_PREFIX + gender
    artifacts = {PLUS.stages[0]: model}
    return Chosen(name, entry["label"], "no --run given", owner, body_model, artifacts, PLUS)
