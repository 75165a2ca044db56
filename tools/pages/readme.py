"""README: whether the paper holds, what the runs took; and the copy of a run's report."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

from benchmarks.claims.__main__ import counted
from benchmarks.claims.claims import claims
from benchmarks.claims.results import KNOWN, NEW, NEW_UNSEEN, UNSEEN, Results
from bridge.exchange.dsnet import LITERAL_DSNETS
from bridge.runs import Run
from dsnet.report.pages import mesh_score, plus_minus, smpl_name
from tools.pages.blocks import RESULTS, ROOT, folder_of, load
from tools.pages.markers import bust


def take_report(run: Run, *, busy: bool = False) -> None:
    """Copy a run's report; note what run and environment weigh, and if the machine was `busy`."""
    report, target = folder_of(run, "report"), RESULTS / run.path.name
    target.mkdir(parents=True, exist_ok=True)
    runs = (run.path, *run.path.parent.glob(f"{run.path.name}-seed*"))
    disk = {"run": sum(map(_size, runs)), "environment": _size(ROOT / ".venv"), "busy": busy}
    (target / "disk.json").write_text(json.dumps(disk) + "\n", encoding="utf-8")
    shutil.copy2(report / "results.json", target / "results.json")
    # Videos stay with the run.
    page = re.sub(
        r"\[[^]]*\]\(videos/.*\n\n", "", (report / "report.md").read_text(encoding="utf-8")
    )
    if busy:
        head = "## How it was made\n\n"
        told = "The machine had other work too: times are upper bounds.\n\n"
        page = page.replace(head, head + told)
    (target / "report.md").write_text(page, encoding="utf-8")
    shutil.rmtree(target / "figures", ignore_errors=True)
    shutil.copytree(report / "figures", target / "figures")


def _size(folder: Path) -> int:
    """Bytes of the files below a folder."""
    return sum(path.lstat().st_size for path in folder.resolve().rglob("*") if not path.is_dir())


def times() -> str:
    """How long both runs took, where, and what they need."""
    environment = load("demo/disk")["environment"] / 1e9
    return (
        f"Without their reports, {_times('demo')};\n{_times('paper')}. "
        f"The environment takes {environment:.1f} GB.\n"
    )


def _times(run: str) -> str:
    results, weighed = load(f"{run}/results"), load(f"{run}/disk")
    disk, busy = weighed["run"] / 1e9, " beside other work" if weighed.get("busy") else ""
    # Verification is a command of its own, no stage of ./reproduce.sh.
    stages = [stage for name, stage in results["stages"].items() if name != "verify"]
    again = results.get("seeds_took_s", {})
    minutes = (sum(stage["wall_time_s"] for stage in stages) + sum(again.values())) / 60
    seeds = f" from {1 + len(again)} seeds" if again else ""
    memory = max(stage["peak_memory_mb"] for stage in stages) / 1000
    return (
        f"[`{run}`](docs/results/{run}/report.md#how-it-was-made) took {minutes:.0f} minutes"
        f"{busy}{seeds}, {memory:.1f} GB of memory and {disk:.1f} GB of disk "
        f"({stages[0]['machine']})"
    )


def verdict() -> str:
    """Whether the paper holds, in three bullets, by the run at the paper's size; and real skin."""
    paper, demo, literal = map(load, ("paper/results", "demo/results", "paper_literal/results"))
    r2 = {cell: best_of(paper, cell)[1] for cell in (KNOWN, NEW, UNSEEN, NEW_UNSEEN)}
    whole = paper["alignments"]["align"]["absorption"]["whole"]
    found = bust()
    return (
        f"- **Claims**: {counted(claims(Results()))} "
        "([each with its number and command](docs/results/claims.md)).\n"
        "- **The paper's words alone**: on a held-out jump R² "
        f"{best_of(literal, 'validation')[1]} at [the paper's size]"
        f"(docs/results/paper_literal/report.md), after {_steps(literal)} steps of its "
        f"autoencoder; {_literal(demo)} in `demo`, after "
        f"{_steps(demo)} ([both readings](docs/paper.md#the-papers-words-alone)).\n"
        f"- **DSNet** reduces SMPL's error on that jump {_reduced(paper, 'validation')}, in "
        f"`demo` {_reduced(demo, 'validation')}. It does not generalise: R² is {r2[KNOWN]} for "
        f"known people and {r2[NEW]} for new people in new takes of known motions, {r2[UNSEEN]} "
        f"and {r2[NEW_UNSEEN]} in unseen motions. One reason: the paper's aligner puts "
        f"{100 * whole['absorbed']:.0f} % of the soft tissue's movement into pose and shape "
        "([findings](docs/findings.md)).\n"
        "- **DSNet+**, which takes inertial and gravitational loads as input in place of the pose, "
        f"reduces it {_reduced(paper, 'validation', 'best')} on that clip, and "
        f"{_reduced(paper, NEW_UNSEEN, 'best')} in unseen motions of new people.\n\n"
        "Real skin: the packaged model, trained on simulated flesh alone, moves the bust of "
        "[a woman with skin markers](docs/markers.md)\n"
        f"by {found['moved']} mm where hers moves {found['hers']} (R² {found['r2']}).\n"
    )


def _literal(results: dict[str, Any]) -> str:
    """R² of the two literal pipelines."""
    scores = [mesh_score(results, "validation", one, "r2") for one in LITERAL_DSNETS.values()]
    return " and ".join(map(plus_minus, scores))


def _steps(results: dict[str, Any]) -> str:
    """Of a run's literal autoencoder."""
    trained = [results["autoencoder"]["training"], *results["autoencoder"]["comparisons"]]
    [literal, *_] = [one for one in trained if one["preset"] == "literal"]
    return f"{literal['steps_taken']:,}"


def card() -> str:
    """What DSNet+ does on truth that is known, and on real skin."""
    demo, found = load("demo/results"), bust()
    return (
        "Trained alike in run `demo`, `dsnet_plus` reduces SMPL's error on synthetic test data "
        f"{_reduced(demo, NEW, 'best')} for new people, {_reduced(demo, NEW_UNSEEN, 'best')} for "
        "new people in unseen motions. In the motion of a real woman with skin markers, the "
        f"packaged model moves the bust by {found['moved']} mm where hers moves {found['hers']} "
        f"(R² {found['r2']}).\n"
    )


def _reduced(results: dict[str, Any], cell: str, pipeline: str = "paper") -> str:
    """From SMPL's error to that of the best of a pipeline's predictors."""
    (smpl, best), r2 = best_of(results, cell, pipeline)
    return f"from {smpl:.2f} to {best:.2f} mm (R² {r2})"


def best_of(
    results: dict[str, Any], cell: str, pipeline: str = "paper"
) -> tuple[tuple[float, float], str]:
    """SMPL's mean error in mm and that of the best of a pipeline's predictors, and its R²."""
    least, best = min(
        (mesh_score(results, cell, name, "mean_mm"), name)
        for name in results["pipelines"][pipeline]["predictors"]
    )
    smpl = results["cells"][cell][smpl_name(results, pipeline)]["mesh"]["mean_mm"]
    return (smpl, least[0]), plus_minus(mesh_score(results, cell, best, "r2"))
