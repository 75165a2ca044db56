"""What the paper says of its data and their alignment (Sections 3 and 6)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.claims.results import KNOWN, UNSEEN, Results
from benchmarks.claims.row import (
    GAINS,
    LICENSED,
    PAPER_RUN,
    STUDY,
    Claim,
    default_of,
    rule,
)
from dsnet.report.paper_table import format_value


def of_data(results: Results) -> Iterator[Claim]:
    aligned = results.paper["alignments"]["align"]
    whole = aligned["absorption"]["whole"]
    turning = results.alignment["joint"]["swing_deg"]
    swing = {name: float(np.mean(turning[name])) for name in ("truth", "align", "align_robust")}
    yield Claim(
        "Dynamics are partly absorbed by the pose: spine2 in 'jiggle on toes'",
        "6, Figure 10",
        f"pose and shape take {100 * whole['absorbed']:.0f} % of the true offsets; spine2 swings "
        f"by {swing['align']:.1f}° (root mean square), in truth {swing['truth']:.1f}°, by the "
        f"robust aligner {swing['align_robust']:.1f}°",
        rule(whole["absorbed"] > 0.1 and swing["align"] > swing["truth"], whole["absorbed"] > 0.1),
        (PAPER_RUN, GAINS),
    )
    gains = results.alignment["gains"][default_of(results.demo)]
    helped = {cell: one["best_r2"] - one["r2"]["1"] for cell, one in gains.items()}
    larger = [cell for cell, one in gains.items() if one["best_gain"] > 1 and helped[cell] > 0.01]
    jump, known = gains["validation"], gains[KNOWN]
    yield Claim(
        "Exaggerating the prediction makes up for it",
        "6",
        f"against the true offsets the best gain on the held-out jump is {jump['best_gain']:.2f}: "
        f"R² {jump['r2']['1']:.2f} becomes {jump['best_r2']:.2f}; in known motions "
        f"{known['best_gain']:.2f} ({known['r2']['1']:.2f} to {known['best_r2']:.2f}),"
        f" in unseen ones {gains[UNSEEN]['best_gain']:.2f}",
        rule(len(larger) == len(gains), bool(larger)),
        (GAINS,),
    )
    sizes = results.networks[0]["components_r2"]
    yield Claim(
        "AMASS's 8 coefficients of DMPL are too coarse",
        "3.2",
        f"here 8 principal components keep R² {sizes['8']:.3f} of the held-out jump, 25 "
        f"{sizes['25']:.3f}, 100 {sizes['100']:.3f}. DMPL's own directions are licensed",
        LICENSED,
        (STUDY,),
    )
    yield Claim(
        "SGD at rate 0.0001 and momentum 0.9 aligns SMPL to the meshes",
        "3.3, Figure 2",
        f"{aligned['frame_error_mm']['mean']:.1f} mm are left to the mesh; against the true "
        f"offsets, the aligned ones have R² {aligned['offsets']['r2']:.2f}: "
        f"{whole['invented_mm']:.1f} mm of {whole['true_mm']:.1f} are invented",
        rule(aligned["offsets"]["r2"] > 0.9, aligned["offsets"]["r2"] > 0),
        (PAPER_RUN,),
    )
    rows = {row["quantity"]: row["ours"] for row in results.paper["paper"]}
    yield Claim(
        "Most sequences have 200 to 400 frames, so 300 is a fair length",
        "5, Figure 6",
        f"our motions are made to that: {rows['frames of most motions']} (80 % of them), clipped "
        f"or padded to {format_value(300)}",
        LICENSED,
        (PAPER_RUN,),
    )
