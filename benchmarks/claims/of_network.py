"""What the paper says of its network (Sections 4 and 5)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.claims.results import KNOWN, NEW, UNSEEN, Results, mean_sd, r2_of
from benchmarks.claims.row import (
    DSNET,
    STUDY,
    Claim,
    clearly_less,
    rule,
)


def of_network(results: Results) -> Iterator[Claim]:
    seeds = results.networks

    def r2(system: str, cell: str = KNOWN) -> float:
        return float(np.mean(r2_of(seeds, system, cell)))

    def said(system: str, cell: str = KNOWN) -> str:
        return mean_sd(r2_of(seeds, system, cell))

    def beside(system: str, name: str) -> str:
        text = (
            f"R² in known motions of known people {said(DSNET)}, {name} {said(system)}; of new "
            f"people {said(DSNET, NEW)} and {said(system, NEW)}; in unseen motions "
            f"{said(DSNET, UNSEEN)} and {said(system, UNSEEN)}"
        )
        clip = [
            mean_sd(found)
            for found in (r2_of(results.papers_networks, s, "validation") for s in (DSNET, system))
            if found
        ]
        if len(clip) < 2:
            return text
        return (
            f"{text}; learned from the paper's aligner, on its held-out clip {' and '.join(clip)}"
        )

    swapped = [one["exchanged_betas"] for one in seeds]
    own, other, moved = (
        [one[KNOWN][key] for one in swapped] for key in ("own", "other", "difference")
    )
    yield Claim(
        "The dynamics are a person's own: distinct for each shape",
        "abstract, 6, Figure 9",
        f"with another woman's β the offsets change by {mean_sd(100 * np.array(moved), 0)} %, and "
        f"R² falls from {mean_sd(own)} to {mean_sd(other)}; of new women from "
        f"{mean_sd(one[NEW]['own'] for one in swapped)} to "
        f"{mean_sd(one[NEW]['other'] for one in swapped)}",
        rule(np.mean(own) - np.mean(other) > 0.05, np.mean(own) > np.mean(other)),
        (STUDY,),
    )
    yield Claim(
        "β at every step is better than β as initial state by radial basis functions",
        "4.3",
        beside("dsnet_rbf", "β as initial state"),
        rule(r2(DSNET) > r2("dsnet_rbf")),
        (STUDY,),
    )
    yield Claim(
        "More LSTM layers do not improve it",
        "4.3",
        f"{beside('dsnet_two_lstm', 'two layers')}; three {said('dsnet_three_lstm')} and "
        f"{said('dsnet_three_lstm', UNSEEN)}",
        rule(r2(DSNET) >= max(r2("dsnet_two_lstm"), r2("dsnet_three_lstm"))),
        (STUDY,),
    )
    yield _batch_norm(results)
    history = {
        seen: [one["history_r2"][KNOWN][seen] for one in seeds]
        for seen in seeds[0]["history_r2"][KNOWN]
    }
    longest = np.mean(history[max(history, key=int)])
    enough = next(seen for seen, found in history.items() if np.mean(found) > longest - 0.01)
    yield Claim(
        "The LSTM learns how far to look back, where others fix two frames",
        "4.2, 1",
        f"shown its last 3 frames alone it has R² {mean_sd(history['3'])}, 10 "
        f"{mean_sd(history['10'])}, all {mean_sd(history['80'])}: it uses {enough}. Trained on "
        f"three frames in place of the LSTM {said('dsnet_two_frames')}",
        rule(int(enough) > 3 and r2(DSNET) > r2("dsnet_two_frames")),
        (STUDY,),
    )
    probe = {
        layer: [one["probe_r2"][layer]["velocity"] for one in seeds]
        for layer in ("input", "fc_enc_2", "lstm")
    }
    yield Claim(
        "The first layers extract inertia from θ, so no velocities are needed",
        "4.3",
        f"R² of the pose's velocity by a linear probe: of the input {mean_sd(probe['input'])}, "
        f"behind the first layers {mean_sd(probe['fc_enc_2'])}, behind the LSTM "
        f"{mean_sd(probe['lstm'])}; the first layers see one pose at a time",
        rule(
            np.mean(probe["fc_enc_2"]) > 0.5, np.mean(probe["lstm"]) > np.mean(probe["input"]) + 0.1
        ),
        (STUDY,),
    )
    yield Claim(
        "Nonlinear, it does better than Dyna's linear law",
        "1, 2",
        beside("dyna_like", "a Dyna-like law"),
        rule(r2(DSNET) > r2("dyna_like"), r2(DSNET, NEW) > r2("dyna_like", NEW)),
        (STUDY,),
    )
    yield Claim(
        "A recurrent network does better than one that is told two past frames",
        "1, 2",
        beside("casas_otaduy_like", "a Casas-Otaduy-like network"),
        rule(r2(DSNET) > r2("casas_otaduy_like"), r2(DSNET, NEW) > r2("casas_otaduy_like", NEW)),
        (STUDY,),
    )


def _batch_norm(results: Results) -> Claim:
    seeds, without = results.networks, "dsnet_no_batch_norm"
    early = {
        name: [one["systems"][name]["loss"][one["epochs"] // 10 - 1] for one in seeds]
        for name in (DSNET, without)
    }
    best = {name: [min(one["systems"][name]["validation_loss"]) for one in seeds] for name in early}
    faster, better = (clearly_less(x[DSNET], x[without]) for x in (early, best))
    return Claim(
        "Batch normalisation helps convergence",
        "5",
        f"loss after {seeds[0]['epochs'] // 10} epochs at rate 0.001: with it "
        f"{mean_sd(early[DSNET], 0)}, without {mean_sd(early[without], 0)}; least on the held-out "
        f"clip {mean_sd(best[DSNET], 0)} and {mean_sd(best[without], 0)}",
        rule(faster and better, faster or better),
        (STUDY,),
    )
