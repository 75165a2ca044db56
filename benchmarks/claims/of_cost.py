"""What the paper says of its cost, and of its autoencoder."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from benchmarks.claims.grounds import SAID, Ground, on_both
from benchmarks.claims.results import KNOWN, NEW, UNSEEN, Results, mean_sd, r2_of
from benchmarks.claims.row import (
    COMPARISON,
    DEMO,
    DSNET,
    GPU,
    PAPER_RUN,
    SECONDS,
    SPEED,
    SUBSPACES,
    Claim,
    Verdict,
    rule,
    smpl_mm,
)


def of_cost(results: Results) -> Iterator[Claim]:
    runtime = results.read("demo/bench/runtime.json")
    fps = {n: 1000 * n / runtime[f"characters_{n}"]["dsnet"]["ms"] / n for n in (1, 16)}
    yield Claim(
        "Real time",
        "abstract, 7",
        f"from pose to posed mesh {fps[1]:.0f} frames a second for one character, {fps[16]:.0f} "
        "for 16, on two CPU cores",
        rule(fps[1] > 60),
        (SPEED,),
    )
    decoding = results.read("demo/bench/peers.json")["decoding"]["1"]
    ours_ms, others_ms = (decoding[f"{name}_onnx"]["ms"] for name in ("paper", "casas_otaduy"))
    bench = results.read("demo/bench/tensorflow.json")
    epoch_s = bench["epoch_s"]
    yield Claim(
        "It saves much computing time",
        "abstract, 7",
        f"a frame takes {bench['step_us']['1']:.0f} µs in DSNet and {ours_ms:.1f} ms in its "
        f"decoder, Casas and Otaduy's decoder {others_ms:.1f} ms, on two CPU cores; DSNet+ from "
        f"pose to posed mesh {runtime['characters_1']['dsnet_plus']['ms']:.1f} ms, DSNet "
        f"{runtime['characters_1']['dsnet']['ms']:.1f}",
        rule(ours_ms < 0.5 * others_ms, ours_ms < others_ms),
        (SPEED,),
    )
    yield Claim(
        "0.05 s an epoch",
        "5",
        f"{epoch_s:.2f} s for 67 sequences of 300 frames on two CPU cores; the paper's was a "
        "GeForce 2080 Super",
        rule(epoch_s <= 0.05, epoch_s < 0.2),
        (SPEED,),
    )
    yield on_both(
        results,
        "Comparable quality to the state of the art at a fraction of the cost",
        "abstract, 1",
        _quality_and_cost,
        "dyna_like",
        "casas_otaduy_like",
    )
    systems = results.comparison[0]["systems"]
    sizes = {name: one["parameters"] for name, one in systems.items()}
    rival = "softsmpl_like"
    asked = results.read("comparison/comparison.json")["command"]
    recorded = ", a recorded one among these" if "--amass" in asked else ""
    r2 = {
        name: [
            mean_sd(one["cells"][cell][name]["r2"] for one in results.comparison)
            for cell in (KNOWN, UNSEEN)
        ]
        for name in (DSNET, rival)
    }
    r2_mean = {
        name: np.mean([one["cells"][KNOWN][name]["r2"] for one in results.comparison])
        for name in r2
    }
    text = (
        f"{sizes[DSNET]:,} parameters beside {sizes[rival]:,} of a SoftSMPL-like one; R² in known "
        f"and unseen motions{recorded}, {' and '.join(r2[DSNET])} beside "
        f"{' and '.join(r2[rival])}"
    )
    lighter, faster, sources = sizes[DSNET] < sizes[rival], True, (COMPARISON,)
    if took := results.seconds:
        ours, its = (took["systems"][name] for name in (DSNET, rival))
        faster = all(ours[key] < its[key] for key in ("epoch_s", "frame_us"))
        text += (
            f"; an epoch of {took['sequences']} sequences takes {ours['epoch_s']:.2f} processor "
            f"seconds beside {its['epoch_s']:.2f}, after {its['begin_s']:.0f} in which that learns "
            f"poses, a frame of a whole motion {ours['frame_us']:.0f} µs beside "
            f"{its['frame_us']:.0f}; DSNet's LSTM is one operation, the other's GRU is Keras's"
        )
        sources = (COMPARISON, SECONDS)
    as_good = r2_mean[DSNET] > r2_mean[rival] - 0.05
    yield Claim(
        "Simpler and lighter than SoftSMPL, thus more efficient to train and evaluate",
        "1, 2",
        text,
        rule(lighter and faster and as_good, lighter or faster),
        sources,
    )


def _quality_and_cost(ground: Ground) -> tuple[str, Verdict]:
    """Of DSNet and those rivals that were trained."""
    rivals = [
        name
        for name in ("dyna_like", "casas_otaduy_like", "softsmpl_like")
        if r2_of(ground.seeds, name, KNOWN)
    ]
    cells = [cell for cell in ground.cells if cell != NEW]
    behind = [
        max(ground.r2(name, cell) for name in rivals) - ground.r2(DSNET, cell) for cell in cells[:2]
    ]
    told = []
    for name in (DSNET, *rivals):
        had = [one["systems"][name] for one in ground.seeds if name in one["systems"]]
        took_s = np.median([one["train_s"] for one in had])
        told.append(
            f"{had[0]['label']}: R² {', '.join(ground.said(name, cell) for cell in cells)}, "
            f"{had[0]['parameters']:,} parameters, trained in {took_s:.0f} s"
        )
    where = ", ".join(SAID[cell] for cell in cells)
    text = f"{'; '.join(told)} (R² {where}; seconds beside other work)"
    return text, rule(max(behind) < 0.05, min(behind) < 0.1)


def of_autoencoder(results: Results) -> Iterator[Claim]:
    demo = results.demo
    mesh, full = (
        run["cells"]["validation"]["autoencoder"]["mesh"] for run in (demo, results.paper)
    )
    yield Claim(
        "The autoencoder reconstructs the mesh faithfully from 100 numbers",
        "4.1, Figure 4",
        f"on the held-out jump {mesh['mean_mm']:.2f} mm of {smpl_mm(demo, 'validation'):.2f}, R² "
        f"{mesh['r2']:.3f}; at the paper's size {full['r2']:.3f}, where it saw the "
        "clip",
        rule(mesh["r2"] > 0.9, mesh["r2"] > 0.5),
        (DEMO, PAPER_RUN),
    )
    codes = {
        name: results.read(f"subspaces/{name}-100-0.json")
        for name in ("mesh_measured", "casas_otaduy", "pca")
    }
    held_out = {name: one["held_out"]["r2"] for name, one in codes.items()}
    longer = results.read("subspaces/steps_6810/mesh_measured-100-0.json")
    yield Claim(
        "Comparable to Casas and Otaduy's",
        "4.1",
        f"R² on sequences that nothing was fitted to, after as many steps: "
        f"{held_out['mesh_measured']:.3f} beside {held_out['casas_otaduy']:.3f}, and "
        f"{longer['held_out']['r2']:.3f} after 100 epochs; PCA of 100 has {held_out['pca']:.3f}",
        rule(held_out["mesh_measured"] > held_out["casas_otaduy"] - 0.01),
        (SUBSPACES,),
    )
    counts = demo["parameters"]
    share = 100 * counts["autoencoder"] / counts["casas_otaduy"]
    yield Claim(
        "33,626,606 parameters, 11.8 % of Casas and Otaduy's 284,678,770",
        "5",
        f"{counts['autoencoder']:,} of {counts['casas_otaduy']:,}: {share:.1f} %. The widths are "
        "inferred from that total",
        rule(counts["autoencoder"] == 33_626_606 and counts["casas_otaduy"] == 284_678_770),
        (DEMO,),
    )
    step_s, plain = results.read("demo/bench/torch.json")["median_s"], "_plain_adam"
    saved_h = _saved_h(step_s)
    gpu = results.read("gpu/torch.json")
    gpu_ms = {name: f"{1e3 * taken:.1f}" for name, taken in gpu["median_s"].items()}
    saved_s = {kind: 3600 * saved for kind, saved in _saved_h(gpu["median_s"]).items()}
    gigabytes = {name: 16e-9 * count for name, count in counts.items()}
    yield Claim(
        "Several hours of training and much memory saved",
        "5",
        f"a step of 64 meshes takes {step_s['mesh_autoencoder']:.2f} s beside "
        f"{step_s['casas_otaduy']:.2f}; with PyTorch's default Adam "
        f"{step_s['mesh_autoencoder' + plain]:.2f} beside {step_s['casas_otaduy' + plain]:.2f}: in "
        f"100 epochs of the paper's 15,051 meshes {saved_h['']:.1f} and {saved_h[plain]:.1f} hours "
        f"on two CPU cores; on one {gpu['gpu']} {gpu_ms['mesh_autoencoder']} ms beside "
        f"{gpu_ms['casas_otaduy']}, and {gpu_ms['mesh_autoencoder' + plain]} beside "
        f"{gpu_ms['casas_otaduy' + plain]}: {saved_s['']:.0f} and {saved_s[plain]:.0f} seconds. "
        f"Weights, gradients and moments: {gigabytes['autoencoder']:.1f} GB "
        f"beside {gigabytes['casas_otaduy']:.1f}",
        rule(saved_h[""] > 2, saved_h[plain] > 2),
        (SPEED, GPU),
    )


def _saved_h(step_s: Mapping[str, float]) -> dict[str, float]:
    """Hours less than Casas and Otaduy's in the paper's 100 epochs, by which Adam."""
    return {
        kind: (step_s[f"casas_otaduy{kind}"] - step_s[f"mesh_autoencoder{kind}"]) * 23_600 / 3600
        for kind in ("", "_plain_adam")
    }
