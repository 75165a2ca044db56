"""Compare each number that the paper prints with ours, read from the manifests of a run."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bridge.exchange import load_weights
from bridge.exchange.dsnet import LITERAL_CODES
from bridge.exchange.train_options import settings_of
from bridge.motion import sequences_of
from bridge.motion.sequences import is_real_motion
from bridge.paper import (
    CASAS_OTADUY_WIDTHS,
    NUMBERS,
    UNSTATED,
    VALIDATION_SEQUENCE,
    PaperNumber,
    Value,
)
from bridge.runs import Artifact
from bridge.runs.untrusted import open_npz
from dsnet.evaluation.evaluation import MESH_ERROR, per_frame_m

Stages = Mapping[str, Artifact]

_PEOPLE = {"female": "women", "male": "men"}
_SET = "set by the run"
_ONE_GENDER = "one gender at a time, like the paper's own training"


@dataclass(frozen=True)
class Measured:
    """One of our numbers, None when the run has none, and the reason why it may differ."""

    value: Value | None
    why: str = ""


def compare(measured: Mapping[str, Measured]) -> list[dict[str, str]]:
    """A row for each of `bridge.paper.NUMBERS`; `measured` needs an entry for each key."""
    return [
        {
            "section": number.section,
            "quantity": number.quantity,
            "paper": format_value(number.value, number.unit),
            # Where the paper states no unit, our value is a text with its unit.
            "ours": format_value(measured[number.key].value, number.unit.removesuffix(UNSTATED)),
            "verdict": verdict(number, measured[number.key]),
        }
        for number in NUMBERS
    ]


def verdict(number: PaperNumber, ours: Measured) -> str:
    """`same` for equal numbers in a stated unit, `differs: <reason>`, or `paper does not say`."""
    if number.value is None:
        return "paper does not say"
    if ours.value == number.value and number.unit != UNSTATED:
        return "same"
    why = ours.why or ("not part of this run" if ours.value is None else "not explained")
    return f"differs: {why}"


def format_value(value: Value | None, unit: str = "") -> str:
    """A value with its unit: integers with thousands separators, others with four digits."""
    if value is None:
        return "-"
    if isinstance(value, tuple):
        text = (", " if len(value) > 2 else " to ").join(map(_format_one, value))
    else:
        text = value if isinstance(value, str) else _format_one(value)
    return f"{text} {unit}".strip() if unit in ("", "%", "s", "1/s", "mm") else f"{text} ({unit})"


def _format_one(value: int | float) -> str:
    if isinstance(value, int) or float(value).is_integer():
        return f"{int(value):,}"
    return f"{value:.4g}"


def parameter_counts(stages: Stages) -> dict[str, int]:
    """Number of parameters of the networks that the paper compares."""
    autoencoders = stages["train-ae"].manifest["parameters"]
    return {
        "autoencoder": autoencoders["mesh_autoencoder"],
        "dsnet": stages["train"].manifest["parameters"]["dsnet"],
        "casas_otaduy": autoencoders["casas_otaduy"],
    }


def measure(stages: Stages, gender: str) -> dict[str, Measured]:
    """Our value for each of `bridge.paper.NUMBERS`; `gender` is that of the run's body model."""
    measured = _data(stages, gender)
    for part in (_sizes, _alignment, _autoencoder, _dsnet, _results):
        measured |= part(stages)
    return measured


def _data(stages: Stages, gender: str) -> dict[str, Measured]:
    sequences = sequences_of(stages["align"])
    tests = [s for s in sequences_of(stages["infer"]) if s.split == "test"]
    per_subject = Counter(sequence.subject for sequence in sequences).values()
    lengths = [s.length for s in sequences]
    durations_s = sorted(s.length / s.fps for s in sequences)
    held_out = ", ".join(s.name for s in sequences if s.split == "validation")
    smaller = f"this run's corpus has {len(sequences)} sequences"
    shortest_s, longest_s = round(durations_s[0], 1), round(durations_s[-1], 1)
    usual = tuple(int(q) for q in np.quantile(lengths, [0.1, 0.9]))
    # The paper counts sequences of both genders; a run has those of its body model's gender.
    other = Measured(None, _ONE_GENDER)
    aligned = Measured(len(sequences), "this run's corpus is smaller")
    predicted = Measured(len(tests), "this run's own held-out set")
    return {
        "subjects": Measured(len(per_subject), smaller),
        "subjects_total": Measured(len(per_subject), _ONE_GENDER),
        "motions_per_subject": Measured((min(per_subject), max(per_subject)), smaller),
        "dyna_fps": Measured(sequences[0].fps, "the files' rate"),
        "mosh_fps": mosh_rate(stages.get("corpus")),
        "duration_s": Measured((shortest_s, longest_s), "this run's corpus"),
        "usual_frames": Measured(usual, "10th and 90th percentile of this run's lengths"),
        "clip_frames": Measured(settings_of(stages["train"].manifest)["frames"], _SET),
        "validation_sequence": Measured(held_out, "set by the run, or not among its sequences"),
        **{f"sequences_{p}": aligned if g == gender else other for g, p in _PEOPLE.items()},
        **{f"mosh_sequences_{p}": predicted if g == gender else other for g, p in _PEOPLE.items()},
    }


def mosh_rate(corpus: Artifact | None) -> Measured:
    """Frame rate of the test motions' files in a corpus."""
    if corpus is None:
        return Measured(None, "the files' own rates, each resampled to 60")
    # Skip real motions (`dsnet corpus --amass`), which keep the rate of their files.
    files = (f for f in corpus.manifest["files"] if f.startswith("mosh/"))
    name = next((f for f in files if not is_real_motion(Path(f).name)), None)
    if name is None:
        return Measured(None, "the files' rate")
    with open_npz(corpus.file(name)) as motion:
        return Measured(round(motion.array("mocap_framerate").item(), 3), "the files' rate")


def _sizes(stages: Stages) -> dict[str, Measured]:
    decode, infer = stages["decode"], stages["infer"]
    shape = decode.array(f"offsets_{decode.manifest['default']}").shape
    theta, betas = infer.array("theta").shape[1], infer.array("betas").shape[1]
    return {
        "vertices": Measured(shape[1]),
        "mesh_size": Measured(shape[1] * shape[2]),
        "joints": Measured((theta - 3) // 3),
        "theta": Measured(theta),
        "betas": Measured(betas),
        "amass_betas": Measured(
            betas, "16 are read, the first 10 are used, as by the paper's DSNet"
        ),
        "amass_dmpls": Measured(None, "read where a file has them, not used by DSNet"),
        "amass_pose": Measured(theta, "156 rotations and 3 of translation are read, 69 are used"),
        "latent_size": Measured(stages["encode"].array("latents").shape[1]),
    }


def _alignment(stages: Stages) -> dict[str, Measured]:
    config = stages["align"].manifest["config"]
    error = stages["evaluate"].manifest["alignments"]["align"]["frame_error_mm"]["mean"]
    measured = {"align_error_mm": Measured(round(error, 3))}
    for key in ("lr", "momentum", "steps"):
        measured[f"align_{key}"] = (
            Measured(config[key], _SET)
            if config["aligner"] == "sgd"
            else Measured(None, f"aligned by `{config['aligner']}`, which has no such setting")
        )
    return measured


def _autoencoder(stages: Stages) -> dict[str, Measured]:
    manifest = stages["train-ae"].manifest
    trained, counts = manifest["autoencoder"], parameter_counts(stages)
    train, validation = trained["train_frames"], trained["validation_frames"]
    steps_an_epoch = math.ceil(train / manifest["config"]["batch_size"])
    share = 100 * counts["autoencoder"] / counts["casas_otaduy"]
    frames = f"floor(0.7 n) and the rest of this run's {train + validation:,} meshes"
    standard = "values leave [-1, 1]: see `autoencoder` under departures"
    literal = trained["preset"] in LITERAL_CODES
    rate = trained["learning_rate"]
    if trained.get("cosine_decay"):
        rate, varies = f"at most {rate:.4g}", "rises and falls: see `autoencoder` under departures"
    else:
        varies = _SET
    # Count linear, convolutional and last linear layers in the weights file.
    names = load_weights(stages["train-ae"].file("autoencoder.safetensors"))
    kinds = ("model.encoder.linear", "model.encoder.conv", "model.to_latent")
    kernels = [name for name in names if name.endswith("weight")]
    layers = tuple(sum(name.startswith(kind) for name in kernels) for kind in kinds)
    return {
        "ae_layers": Measured(layers),
        "ae_widths": Measured("-".join(map(str, manifest["architecture"]["widths"]))),
        "ae_activation": Measured("leaky_relu"),
        "ae_parameters": Measured(counts["autoencoder"]),
        "casas_otaduy_parameters": Measured(counts["casas_otaduy"]),
        "casas_otaduy_widths": Measured(CASAS_OTADUY_WIDTHS[1:]),
        "parameter_share": Measured(round(share, 1)),
        "ae_train_frames": Measured(train, frames),
        "ae_validation_frames": Measured(validation, frames),
        "ae_train_share": Measured(round(100 * train / (train + validation)), frames),
        "ae_input_range": Measured((-1, 1)) if literal else Measured(None, standard),
        "ae_batch": Measured(manifest["config"]["batch_size"], _SET),
        "ae_lr": Measured(rate, varies),
        "ae_epochs": Measured(round(trained["steps_taken"] / steps_an_epoch, 1)),
        "ae_r2": Measured(round(trained["r2_validation"], 4)),
    }


def _dsnet(stages: Stages) -> dict[str, Measured]:
    manifest = stages["train"].manifest
    config, name = settings_of(manifest), stages["infer"].manifest["default"]
    predictor, made = manifest["predictors"][name], manifest["provenance"]
    weights = load_weights(stages["train"].file(f"{name}.safetensors"))
    # Whether latents are scaled is read from the weights, so that any predictor will do.
    scaled = np.any(weights.get("scaling/latent_std", np.float32(1)) != 1)
    departs = "; ".join(predictor["departures"]) or _SET
    inputs, latent = weights["fc_enc_1/kernel"].shape[0], weights["fc_enc_3/kernel"].shape[1]
    block = (config["batch_size"], config["frames"])
    return {
        "dsnet_input": Measured(inputs),
        "fc_enc_1": Measured(weights["fc_enc_1/kernel"].shape[1]),
        "fc_enc_2": Measured(weights["fc_enc_2/kernel"].shape[1]),
        "lstm": Measured(weights["lstm/recurrent_kernel"].shape[0]),
        "fc_enc_3": Measured(latent),
        "dsnet_parameters": Measured(manifest["parameters"]["dsnet"]),
        "dsnet_batch": Measured(config["batch_size"], _SET),
        "input_block": Measured(
            (*block, inputs), "beta enters at each step too, as the same section says: 79 wide"
        ),
        "output_block": Measured((*block, latent), _SET),
        "dsnet_lr": Measured(predictor["lr"], f"`{name}`: {departs}"),
        "epoch_s": Measured(made.get(f"epoch_s_{name}"), f"another machine: {made['machine']}"),
        "dsnet_epochs": Measured(config["epochs"]),
        "latent_scale": Measured(
            "one standard deviation" if scaled else "as the autoencoder gives"
        ),
    }


def _results(stages: Stages) -> dict[str, Measured]:
    evaluate, name = stages["evaluate"], stages["decode"].manifest["default"]
    evaluated = validation_result(evaluate)
    error_m = per_frame_m(evaluate, MESH_ERROR, name, evaluated["name"]) if evaluated else None
    if evaluated is None or error_m is None:
        missing = Measured(None, "no validation sequence in this run")
        return {"figure8_error": missing, "dsnet_r2": missing}
    ends_m = float(error_m.min()), float(error_m.max())
    metres, centimetres = (
        " to ".join(f"{scale * end_m:.2g}" for end_m in ends_m) for scale in (1, 100)
    )
    return {
        "figure8_error": Measured(
            f"{metres} m, {centimetres} cm", "the unit is not stated, and the data are others"
        ),
        "dsnet_r2": Measured(round(evaluated["errors"][name]["mesh"]["r2"], 4)),
    }


def validation_result(evaluate: Artifact) -> dict[str, Any] | None:
    """Errors on the paper's validation sequence, or else on the run's first validation sequence."""
    validation = [r for r in evaluate.manifest["per_sequence"] if r["split"] == "validation"]
    papers = [result for result in validation if result["name"] == VALIDATION_SEQUENCE]
    return next(iter(papers + validation), None)
