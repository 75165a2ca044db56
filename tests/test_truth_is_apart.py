"""The simulated truth is made by the corpus stage, read by evaluation, shown by view and report."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[1]
MAKES_IT = "dsnet/synthetic/stage_corpus.py"
READS_IT = "dsnet/evaluation/evaluation.py"
# To be looked at beside predictions, and for their errors over time; no predictor is given any.
SHOWS_IT = "dsnet/view/clip_list.py"
# The true pose beside the fitted ones, Figure 10, and its wall time.
DRAWS_ITS_POSE = "dsnet/report/stage_report.py"
NAMES_ITS_DIGEST = "dsnet/report/results.py"
NAMES_ITS_COMMAND = "bridge/runs/run.py"


def test_no_other_module_names_the_truth_artifact():
    sources = [
        path
        for package in ("bridge", "dsnet", "torch_align_ae", "tf_dsnet")
        for path in (ROOT / package).rglob("*.py")
    ]
    naming = {
        path.relative_to(ROOT).as_posix() for path in sources if '"truth"' in path.read_text()
    }
    mention = {NAMES_ITS_COMMAND, NAMES_ITS_DIGEST}
    assert naming == {MAKES_IT, READS_IT, SHOWS_IT, DRAWS_ITS_POSE} | mention


def test_the_chain_opens_no_array():
    assert ".array(" not in (ROOT / NAMES_ITS_COMMAND).read_text()


def test_the_viewer_reads_it_in_one_place():
    readers = [p for p in (ROOT / "dsnet" / "view").glob("*.py") if "open_truth" in p.read_text()]
    assert {path.name for path in readers} == {"clip_list.py"}


def test_the_report_asks_the_truth_for_no_array():
    others = list((ROOT / "dsnet" / "report").glob("*.py"))
    assert others
    assert not any('["truth"].array' in path.read_text() for path in others)
