"""Numbers that stand in a sentence are those of the results files that it is about."""

from __future__ import annotations

import json
from collections.abc import Iterator
from statistics import mean, median
from typing import Any

import pytest

from bridge.motion.splits import CELLS
from tests.pages import ROOT

UNSEEN, NEW_UNSEEN = "known_person_unseen_motion", "new_person_unseen_motion"


def results(name: str) -> Any:
    return json.loads((ROOT / "docs" / "results" / f"{name}.json").read_text(encoding="utf-8"))


def laws() -> Iterator[str]:
    runs = results("alignment/laws")["runs"]
    r2 = {name: f"{runs[name]['r2']:.3f}" for name in ("bed_own", "bed_second", "bed_third")}
    own, second, third = r2.values()
    yield f"{own} under `own`, {second} under `second` and {third} under `third`"
    yield f"captured-like form it is {runs['bed_captured']['r2']:.2f}:"


def steps() -> Iterator[str]:
    rules = results("alignment/convergence")["rules"]
    r2 = {
        rule["steps"]: f"{rule['r2']:.2f}"
        for rule in rules
        if rule["kind"] == "fixed" and rule["betas"] == "true"
    }
    yield f"{r2[50]} after 50 steps a frame, {r2[100]} after 100, {r2[400]} after 400"
    yield f"and {r2[800]} after 800"
    falling = next(
        rule
        for rule in rules
        if (rule["kind"], rule["steps"], rule["betas"]) == ("decayed", 400, "true")
    )
    yield f"falls to zero within a frame gives {falling['r2']:.2f} in 400 steps"


def unlike() -> Iterator[str]:
    rows = results("tissue_laws/tissue_laws")["rows"]
    ends = {}
    for law in ("second", "third"):
        shares = [100 * row["laws"][law]["unlike"] for row in rows]
        ends[law] = f"{min(shares):.0f} to {max(shares):.0f} %"
    yield f"offsets, {ends['second']} are no multiple of the own law's, of the third's"
    yield ends["third"]


def held_out() -> Iterator[str]:
    without, with_clip, _ = results("held_out/held_out")["rows"]
    yield f"from {without['r2_held_out']:.3f} to {with_clip['r2_held_out']:.3f}"


def papers_size() -> Iterator[str]:
    paper = results("paper/results")
    cells, seeds = paper["cells"], paper["seeds"]["cells"]
    r2 = {
        (cell, name): seeds[cell][name]["mesh"]["r2"]
        for cell in ("validation", UNSEEN)
        for name in ("dsnet_standardised", "dsnet_faithful")
    }
    best = max(number["mean"] for (cell, _), number in r2.items() if cell == "validation")
    yield f"R² of the posed mesh is {best:.2f}, and the code"
    unseen = r2[UNSEEN, "dsnet_standardised"]
    yield f"(R² {unseen['mean']:.2f} ± {unseen['sd']:.2f}, known people)"
    (plus,) = {f"{cells[cell]['dsnet_plus']['offsets']['r2']:.2f}" for cell in (*CELLS, "train")}
    yield f"`dsnet_plus` has R² {plus} in every group**"


def side_by_side() -> Iterator[str]:
    files = sorted((ROOT / "docs" / "results" / "comparison").glob("own-[0-9].json"))
    seeds = [results(f"comparison/{path.stem}") for path in files]

    def r2(name: str, cell: str) -> float:
        return mean(seed["cells"][cell][name]["r2"] for seed in seeds)

    (plus,) = {f"{r2('dsnet_plus', cell):.2f}" for cell in CELLS}
    first, second = (
        f"{max(r2(name, cell) for name in seeds[0]['systems']):.2f}"
        for cell in ("known_person_unseen_motion", NEW_UNSEEN)
    )
    yield f"R² {plus}; in unseen motions the next has {first} and {second}."


def of_seeds(corpus: str) -> list[Any]:
    """The test bed's scores of a corpus."""
    found = sorted((ROOT / "docs" / "results" / "prediction").glob(f"{corpus}-[0-9].json"))
    return [results(f"prediction/{path.stem}") for path in found]


def bed(corpus: str) -> str:
    """R² of a new person's unseen motions, the mean over seeds."""
    scores = of_seeds(corpus)
    r2s = [score["cells"][NEW_UNSEEN]["dsnet_plus"]["offsets"]["r2"] for score in scores]
    return f"{mean(r2s):.2f}"


def tissues() -> Iterator[str]:
    yield f"{bed('own')} under the law `own`, on which the settings were chosen, {bed('second')}"
    yield f"under `second` and {bed('third')} under `third`; for men under `own` {bed('male')}."
    yield f"real motion: {real('second')} under the second law and {real('third')} under the third"


def real(corpus: str) -> str:
    """R² of the new person's real motion, the mean over seeds."""
    r2s = [
        clip["errors"]["dsnet_plus"]["offsets"]["r2"]
        for scores in of_seeds(corpus)
        for clip in scores["sequences"]
        if clip["name"].startswith("99001_amass")
    ]
    return f"{mean(r2s):.2f}"


def strangers() -> Iterator[str]:
    found = [results("prediction/strangers")["found"][gender] for gender in ("female", "male")]
    whole, chest, thighs = (
        " and ".join(dict.fromkeys(f"{one['new people'][part]['median']:.2f}" for one in found))
        for part in ("all", "chest", "thighs")
    )
    yield f"swing at {whole} times the frequency that the law gives them, their chests at {chest}"
    yield f"times, their thighs at {thighs}"


def recordings() -> Iterator[str]:
    def of(law: str, key: str, digits: int = 2) -> str:
        clips = [c for c in runs[f"bed_{law}"] if c["smoothed"] == "as recorded"]
        each = [
            median(c[key] for c in clips if c["who"] == who)
            for who in ("known person", "new person")
        ]
        return " and ".join(dict.fromkeys(f"{one:.{digits}f}" for one in each))

    runs = results("prediction/recordings")["runs"]
    worst = min(clip["r2"] for clip in runs["bed_own"])
    yield f"R² is {of('own', 'r2')} for known and new people, in the worst clip {worst:.2f}"
    yield f"under the second {of('second', 'r2')}, under the third {of('third', 'r2')}"
    worst = min(c["settled_r2"] for c in runs["bed_third"] if c["smoothed"] == "as recorded")
    yield f"its R² is {of('third', 'settled_r2')}, {worst:.2f} in the worst clip"
    yield f"below 8 Hz R² is {of('second', 'slow_r2')} under the second law"


def noise() -> Iterator[str]:
    def r2(run: str, cutoff: str) -> str:
        each = [clip["scores"][cutoff]["noisy"]["offsets"] for clip in runs[run]]
        missed, whole = (sum(part) for part in zip(*each, strict=True))
        return f"{1 - missed / whole:.3f}"

    runs = results("prediction/noise")["runs"]
    best = {
        run: max((r2(run, hz), hz) for hz in runs[run][0]["scores"] if hz != "auto") for run in runs
    }
    (second, hz), (own, own_hz) = best["bed_second"], best["bed_own"]
    yield f"law ({r2('bed_second', 'auto')}; {hz} Hz: {second})"
    yield f"({r2('bed_own', 'auto')}; {own_hz} Hz: {own}, and a better velocity)"


def many_motions() -> Iterator[str]:
    found = results("scaling/many_motions")["written"]["offsets"]
    whole, half = found["amass"], results("scaling/many_motions")["written"]["offsets16"]["amass"]
    rate = found["frames_an_hour_and_core"] / 1e6
    yield f"One core writes {rate:.1f} million frames an hour"
    yield f"take {whole['core_hours']:.1f} hours of one core"
    yield f"{whole['hours_by_cores']['16']:.2f} on sixteen"
    yield f"which takes {half['core_hours']:.1f} hours of one core"
    yield f"{whole['bytes'] / 1e9:.0f} GB, {half['bytes'] / 1e9:.0f} as `offsets16`"
    yield f"{whole['bytes_a_second_and_core'] / 1e6:.0f} MB a second for each core"


SAID = {
    "alignment": (laws, steps),
    "data": (unlike,),
    "findings": (held_out, papers_size, side_by_side),
    "motion_files": (many_motions,),
    "prediction": (tissues, strangers, recordings, noise),
}


@pytest.mark.parametrize("page", SAID)
def test_sentences_say_what_the_files_say(page: str) -> None:
    text = " ".join((ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8").split())
    assert not [said for made in SAID[page] for said in made() if said not in text]
