"""`dsnet verify`: compare the engines with the reference, and fail if they differ.

PyTorch and Keras are compared with the NumPy reference in layers, losses, gradients, training
steps and SMPL, also on a GPU where there is one; PyTorch in the paper's alignment, Keras in the
files that it writes; ONNX Runtime in the exported graphs, from latents to offsets and from poses to
the posed skin; the streaming predictor in its latents.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from tyro.conf import Fixed

from bridge.errors import DsnetError
from bridge.options import Seed
from bridge.runs import ArtifactWriter, Run
from bridge.runs.run import body_model_path
from dsnet.verify.checks import full_size_checks, random_checks
from dsnet.verify.compare import TOLERANCES, Row, Skipped, diagnose, skipped_rows, verify
from dsnet.verify.engines import EngineResult
from dsnet.verify.trained_checks import trained_checks

STAGE = "verify"
EMBEDDED_BODY = "embedded:female"


@dataclass(frozen=True)
class VerifyConfig:
    """Compare PyTorch and Keras with a float64 reference: layers, gradients, steps, SMPL,
    alignment; and the exported files and ONNX graphs.

    Engines run as processes, one after the other. Prints a table, writes `parity.json`; exits with
    1 when anything differs by more than its tolerance.
    """

    run: str = "demo"
    """Run whose trained weights and motions are compared beside random ones."""
    seed: Seed = 0
    """Seed of the random weights and inputs."""
    trained: bool = True
    """Compare the run's trained weights too; without them no run is needed."""
    full_size: Fixed[bool] = True
    """Compare the autoencoder of random weights at its 33,626,606 parameters."""


PROFILES = {
    "smoke": VerifyConfig(run="smoke", full_size=False),
    "demo": VerifyConfig(run="demo"),
    "paper": VerifyConfig(run="paper"),
}


def main(config: VerifyConfig) -> None:
    """Compare, print and write; an earlier result is never reused."""
    run = Run(config.run)
    if config.trained and not run.path.is_dir():
        raise DsnetError(
            f"unknown run {config.run!r}",
            f"a run in {run.path.parent}",
            "Run ./reproduce.sh first, or pass --no-trained to compare random weights.",
        )
    with run.alone(STAGE, resumed=False):  # there are no checkpoints to resume from
        rows, skipped = _make(config, run)
    found = summary(rows, diagnose(rows), skipped)
    sys.stdout.write(f"{text_table(rows, skipped)}\n\n{found}\n")
    sys.exit(0 if all(row.passed for row in rows) else 1)


def _make(config: VerifyConfig, run: Run) -> tuple[list[Row], list[Skipped]]:
    trained = ("encode", "train-ae", "train", "train_plus") if config.trained else ()
    sources = {s: run.artifact(s) for s in ("align", *trained) if run.finished(s)}
    origin = sources["align"].origin if "align" in sources else "synthetic"
    body = str(body_model_path(run)) if "align" in sources else EMBEDDED_BODY
    # Not `run.build`, which would keep an earlier result.
    writer = ArtifactWriter(run.path / STAGE, STAGE, data=origin)
    checks = random_checks(config.seed, body)
    if config.full_size:
        checks += full_size_checks(config.seed)
    if config.trained:
        checks += trained_checks(run)
    rows, results = verify(checks, writer.checkpoints / "work")
    skipped = skipped_rows(checks, results)
    text = json.dumps(parity(rows, results, skipped), indent=1, allow_nan=False) + "\n"
    writer.file_path("parity.json").write_text(text, encoding="utf-8")
    settings = {key: value for key, value in asdict(config).items() if key != "run"}
    upstream = {name: source.content_sha256 for name, source in sources.items()}
    writer.finish(config=settings, upstream=upstream)
    return rows, skipped


def parity(
    rows: Sequence[Row], results: Mapping[str, EngineResult], skipped: Sequence[Skipped]
) -> dict[str, Any]:
    """The contents of `parity.json`; infinite differences are null."""
    return {
        "passed": all(row.passed for row in rows),
        "diagnosis": diagnose(rows),
        "tolerances": TOLERANCES,
        "engines": {
            name: dict(result.versions) for name, result in results.items() if not result.missing
        },
        "skipped": [asdict(one) for one in skipped],
        "rows": [
            {key: None if value == float("inf") else value for key, value in asdict(row).items()}
            for row in rows
        ],
    }


def text_table(rows: Sequence[Row], skipped: Sequence[Skipped]) -> str:
    """The rows as aligned columns, with a line of column names; those that were skipped last."""
    lines = [list(_columns(rows[0])), *(list(_columns(row).values()) for row in rows)]
    lines += [
        [one.check, "all", one.engine, one.dtype, *[""] * 5, f"skipped: {one.reason}"]
        for one in skipped
    ]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join("  ".join(map(str.ljust, line, widths)).rstrip() for line in lines)


def _columns(row: Row) -> dict[str, str]:
    return {
        "check": row.check,
        "part": row.part,
        "engine": row.engine,
        "precision": row.dtype,
        "max abs": f"{row.max_abs:.1e}",
        "max rel": f"{row.max_rel:.1e}",
        "worst tensor": row.tensor,
        "index": ",".join(map(str, row.index)),
        "tolerance": f"{row.tolerance:.0e}",
        "verdict": "ok" if row.passed else f"FAIL {row.problem or 'first: ' + row.first}",
    }


def summary(
    rows: Sequence[Row], diagnosis: Mapping[str, Sequence[str]], skipped: Sequence[Skipped]
) -> str:
    """How many rows hold and were skipped; of those that fail the causes, with their checks."""
    failed = sum(not row.passed for row in rows)
    if not failed:
        return f"{len(rows)} of {len(rows)} rows hold{skipped_text(skipped)}"
    causes = [
        f"  {cause}\n    in {', '.join(sorted(set(checks)))}" for cause, checks in diagnosis.items()
    ]
    return "\n".join([f"{failed} of {len(rows)} rows FAIL; what differs first:", *causes])


def skipped_text(skipped: Sequence[Skipped]) -> str:
    """`, 20 skipped: no GPU`; nothing where none was."""
    reasons = ", ".join(dict.fromkeys(one.reason for one in skipped))
    return f", {len(skipped)} skipped: {reasons}" if skipped else ""
