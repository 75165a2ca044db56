"""What the paper says of its network (Sections 4 and 5), on both grounds."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from benchmarks.claims.grounds import SAID, Ground, on_both
from benchmarks.claims.of_training import of_end_to_end, of_range
from benchmarks.claims.results import NEW, Results, mean_sd
from benchmarks.claims.row import DSNET, Claim, Verdict, clearly_less, rule


def of_network(results: Results) -> Iterator[Claim]:
    """Of the network's parts, then of the whole beside what there was."""
    own = "abstract, 6, Figure 9"
    both = partial(on_both, results)
    yield both("The dynamics are a person's own: distinct for each shape", own, _own_dynamics)
    yield both(
        "β at every step is better than β as initial state by radial basis functions",
        "4.3",
        partial(_better_than, systems={"dsnet_rbf": "β as initial state"}),
        "dsnet_rbf",
    )
    layers = {"dsnet_two_lstm": "two layers", "dsnet_three_lstm": "three"}
    yield both(
        "More LSTM layers do not improve it",
        "4.3",
        partial(_better_than, systems=layers),
        *layers,
    )
    yield both("Batch normalisation helps convergence", "5", _batch_norm, "dsnet_no_batch_norm")
    if results.batch_norm:
        yield of_range(results.batch_norm)
    yield both(
        "The LSTM learns how far to look back, where others fix two frames",
        "4.2, 1",
        _history,
        "dsnet_two_frames",
    )
    yield both(
        "The first layers extract inertia from θ, so no velocities are needed", "4.3", _inertia
    )
    yield of_end_to_end(results)
    yield both(
        "Nonlinear, it does better than Dyna's linear law",
        "1, 2",
        partial(_better_than_rival, system="dyna_like", name="a Dyna-like law"),
        "dyna_like",
    )
    yield both(
        "A recurrent network does better than one that is told two past frames",
        "1, 2",
        partial(_better_than_rival, system="casas_otaduy_like", name="a Casas-Otaduy-like network"),
        "casas_otaduy_like",
    )


def _own_dynamics(ground: Ground) -> tuple[str, Verdict]:
    swapped = [one["exchanged_betas"] for one in ground.seeds]
    decides, *_ = ground.cells
    own, other, moved = (
        [one[decides][key] for one in swapped] for key in ("own", "other", "difference")
    )
    text = (
        f"with another woman's β the offsets change by {mean_sd(100 * np.array(moved), 0)} %, and "
        f"R² {SAID[decides]} falls from {mean_sd(own)} to {mean_sd(other)}; of new women from "
        f"{mean_sd(one[NEW]['own'] for one in swapped)} to "
        f"{mean_sd(one[NEW]['other'] for one in swapped)}"
    )
    return text, rule(np.mean(own) - np.mean(other) > 0.05, np.mean(own) > np.mean(other))


def _better_than(ground: Ground, systems: dict[str, str]) -> tuple[str, Verdict]:
    (first, name), *more = systems.items()
    others = "".join(
        f"; {name} {', '.join(ground.said(system, cell) for cell in ground.cells)}"
        for system, name in more
    )
    best = max(ground.r2(system) for system in systems)
    return f"{ground.beside(first, name)}{others}", rule(ground.r2(DSNET) >= best)


def _better_than_rival(ground: Ground, system: str, name: str) -> tuple[str, Verdict]:
    better = [ground.r2(DSNET, cell) > ground.r2(system, cell) for cell in ground.cells[:2]]
    return ground.beside(system, name), rule(better[0], better[1])


def _batch_norm(ground: Ground) -> tuple[str, Verdict]:
    seeds, without = ground.seeds, "dsnet_no_batch_norm"
    tenth = seeds[0]["epochs"] // 10
    early = {
        name: [one["systems"][name]["loss"][tenth - 1] for one in seeds]
        for name in (DSNET, without)
    }
    best = {name: [min(one["systems"][name]["validation_loss"]) for one in seeds] for name in early}
    faster, better = (clearly_less(x[DSNET], x[without]) for x in (early, best))
    text = (
        f"loss after {tenth} epochs: with it {mean_sd(early[DSNET], 0)}, without "
        f"{mean_sd(early[without], 0)}; least on the held-out clip {mean_sd(best[DSNET], 0)} and "
        f"{mean_sd(best[without], 0)}"
    )
    return text, rule(faster and better, faster or better)


def _history(ground: Ground) -> tuple[str, Verdict]:
    cell, *_ = ground.cells
    history = {
        seen: [one["history_r2"][cell][seen] for one in ground.seeds]
        for seen in ground.seeds[0]["history_r2"][cell]
    }
    longest = np.mean(history[max(history, key=int)])
    enough = next(seen for seen, found in history.items() if np.mean(found) > longest - 0.01)
    text = (
        f"shown its last 3 frames alone it has R² {mean_sd(history['3'])}, 10 "
        f"{mean_sd(history['10'])}, all {mean_sd(history['80'])}: it uses {enough}. Trained on "
        f"three frames in place of the LSTM {ground.said('dsnet_two_frames')}"
    )
    return text, rule(int(enough) > 3 and ground.r2(DSNET) > ground.r2("dsnet_two_frames"))


def _inertia(ground: Ground) -> tuple[str, Verdict]:
    probe = {
        layer: [one["probe_r2"][layer]["velocity"] for one in ground.seeds]
        for layer in ("input", "fc_enc_2", "lstm")
    }
    text = (
        f"R² of the pose's velocity by a linear probe: of the input {mean_sd(probe['input'])}, "
        f"behind the first layers {mean_sd(probe['fc_enc_2'])}, behind the LSTM "
        f"{mean_sd(probe['lstm'])}; the first layers see one pose at a time"
    )
    found_there = np.mean(probe["lstm"]) > max(np.mean(probe["input"]), 0) + 0.1
    return text, rule(np.mean(probe["fc_enc_2"]) > 0.5, found_there)
