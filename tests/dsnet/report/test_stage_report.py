"""The stage `report` on the forged run: complete, honest about its data, and self-contained."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
from collections import Counter
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence

from bridge import DsnetError
from bridge.body import load_body_model
from bridge.runs import ArtifactWriter, Run, read_artifact
from dsnet.evaluation.evaluation import evaluate_run
from dsnet.evaluation.pipelines import MotionArrays, Pipeline
from dsnet.pictures.panels import FOOTERS
from dsnet.report import paper_table, stage_report, videos
from dsnet.report.bodies import Scene
from dsnet.report.diagrams import sizes_of
from dsnet.report.pages import render_html, render_markdown
from dsnet.report.paper_table import compare, measure
from dsnet.report.results import departures
from tests.forged.best_pipeline import write_best_pipeline

FIGURES = (
    "figure1_strip", "figure2_alignment", "figure3_autoencoder", "figure4_autoencoder",
    "figure5_dsnet", "figure6_lengths", "figure7_validation", "figure8_error", "figure9_people",
    "figure10_spine2", "over_time", "spectrum", "loss_autoencoder", "loss_dsnet", "loss_plus",
)  # fmt: skip
TINY = stage_report.ReportConfig(run="both", panel_px=48)


@pytest.fixture(scope="module")
def folder(forged_runs, tmp_path_factory):
    runs = tmp_path_factory.mktemp("runs")
    later = shutil.ignore_patterns("evaluate", "report")
    shutil.copytree(forged_runs / "forged", runs / "both", ignore=later)
    write_best_pipeline(runs / "both")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DSNET_RUNS", str(runs))
        evaluate_run(Run("both"))
        stage_report.main(TINY)
    return runs / "both" / "report"


def test_every_figure_is_shown_and_every_shown_one_exists(folder):
    shown = re.findall(r"\(figures/([\w.-]+)\)", (folder / "report.md").read_text())
    drawn = sorted(path.name for path in (folder / "figures").iterdir())
    assert shown == ["held_out.webp", *(f"{name}.png" for name in FIGURES)]
    assert drawn == sorted(shown)


def test_pages_say_synthetic_once_at_the_start(folder):
    text = (folder / "report.md").read_text()
    assert "**Synthetic data.**" in text[:100]
    assert text.count("Synthetic data") == 1
    page = (folder / "report.html").read_text()
    assert FOOTERS["synthetic"] in page.partition("<h1>")[0]
    assert page.count(FOOTERS["synthetic"]) == 1
    assert json.loads((folder / "results.json").read_text())["data"] == "synthetic"


def test_html_needs_no_other_file(folder):
    page = (folder / "report.html").read_text()
    sources = re.findall(r'(?:src|href)="([^"#][^"]{0,40})', page)
    kinds = Counter(source.partition(";base64,")[0] for source in sources)
    files = [path for name in ("figures", "videos") for path in folder.glob(f"{name}/*")]
    embedded = {".png": "data:image/png", ".webp": "data:image/webp", ".mp4": "data:video/mp4"}
    assert kinds == Counter(embedded[path.suffix] for path in files)
    assert kinds["data:image/png"] == len(FIGURES)
    encoded = re.findall(r"base64,([^\"]+)", page)
    assert {base64.b64decode(text) for text in encoded} == {path.read_bytes() for path in files}
    assert not re.search(r"<script|@import|url\(", page)
    assert page.count("<table>") == page.count('<div class="wide">') > 5


def assert_moves(pages: np.ndarray, columns: int) -> None:
    """Pages (T, height, width, 3): in each column a body that moves, below them the notice."""
    assert pages.ndim == 4
    column_px = (pages.shape[2] - 62) // columns
    for column in range(columns):
        own = pages[:, 30:-22, column * column_px : (column + 1) * column_px]
        assert (own.min(axis=-1) < 200).mean() > 0.02
        assert np.abs(np.diff(own, axis=0)).max() > 50
    foot = pages[:, -20:].reshape(len(pages), -1, 3)
    assert ((foot[..., 0] - foot[..., 2]) > 60).any(axis=1).all()


def test_the_held_out_motion_moves_at_the_head(folder):
    """In a loop: every second frame of nine at 30 a second; a column for each pipeline and two."""
    head = (folder / "report.md").read_text().partition("[Verdict](#verdict)")[0]
    assert "](figures/held_out.webp)" in head
    assert "*50004_one_leg_jump in real time, on which no predictor was trained" in head
    with Image.open(folder / "figures" / "held_out.webp") as clip:
        assert (clip.format, clip.info["loop"]) == ("WEBP", 0)
        pages = np.stack(
            [np.asarray(one.convert("RGB"), int) for one in ImageSequence.Iterator(clip)]
        )
        assert clip.info["duration"] == 33
    assert len(pages) == 5
    assert_moves(pages, 4)


def test_the_clip_is_no_wider_than_the_page(tmp_path):
    pages = [Image.new("RGB", (1800, 301), colour) for colour in ("red", "blue")]
    videos.write_webp(tmp_path / "a.webp", pages, 30)
    with Image.open(tmp_path / "a.webp") as clip:
        assert clip.size == (900, 150)


def test_figures_7_and_9_move(folder):
    """Every second frame of nine at 30 a second; a column for each pipeline, or each person."""
    ffmpeg = pytest.importorskip("imageio_ffmpeg").get_ffmpeg_exe()
    shown = re.findall(r"\(videos/([\w.-]+)\)", (folder / "report.md").read_text())
    assert shown == ["figure7_validation.mp4", "figure9_people.mp4"]
    for name, columns, pictures in zip(shown, (4, 2), (5, 2), strict=True):
        raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
        command = [ffmpeg, "-i", str(folder / "videos" / name), *raw]
        done = subprocess.run(command, capture_output=True, check=True)
        said = done.stderr.decode()
        assert "30 fps" in said
        assert re.search(r"comment +: synthetic", said)
        ((width, height),) = {(int(w), int(h)) for w, h in re.findall(r" (\d{3,})x(\d+)", said)}
        pages = np.frombuffer(done.stdout, np.uint8).reshape(-1, height, width, 3).astype(int)
        assert len(pages) == pictures
        assert_moves(pages, columns)


def test_without_an_encoder_the_report_moves_all_the_same(folder, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(videos, "find_spec", lambda name: None)
    stages = {path.name: read_artifact(path) for path in folder.parent.iterdir() if path != folder}
    scene = Scene(stages, load_body_model("embedded:female"), 48)
    moving = [one for one in stage_report.plan_figures(scene) if one.name in FIGURES[6:9:2]]
    assert [one.name for one in moving] == ["figure7_validation", "figure9_people"]
    writer = ArtifactWriter(tmp_path / "report", "report", data="synthetic")
    assert videos.write_videos(writer, moving, 2) == []
    made = {path.name for path in tmp_path.rglob("*") if path.suffix in (".webp", ".mp4")}
    assert made == {"held_out.webp"}
    said = capsys.readouterr().err
    assert "left out: videos, which need imageio-ffmpeg. Install the extra" in said


def test_results_hold_the_numbers(folder):
    results = json.loads((folder / "results.json").read_text())
    counts = {"autoencoder": 33_626_606, "dsnet": 65_140, "casas_otaduy": 284_678_770}
    assert results["parameters"] == counts
    (held_out,) = (one for one in results["sequences"] if one["split"] == "validation")
    assert held_out["name"] == "50004_one_leg_jump"
    assert 0.5 < held_out["errors"]["dsnet_small"]["mesh"]["r2"] < 1.0
    assert results["pipelines"]["paper"]["default"] == "dsnet_small"
    assert results["stages"]["train"]["seed"] == 0
    assert "numpy" in results["stages"]["train"]["versions"]
    verdicts = {row["quantity"]: row["verdict"] for row in results["paper"]}
    assert verdicts["parameters of the autoencoder"] == "same"
    assert verdicts["Dyna sequences, women"].startswith("differs: ")
    assert verdicts["parameters of DSNet"] == "paper does not say"


def test_sequences_are_counted_among_their_own_gender(folder):
    finished = folder.parent
    stages = {path.name: read_artifact(path) for path in finished.iterdir() if path != folder}
    for gender, counted in [("female", "women"), ("male", "men"), ("neutral", "nobody")]:
        ours = measure(stages, gender)
        for people in ("women", "men"):
            expected = (3, 2) if people == counted else (None, None)
            keys = f"sequences_{people}", f"mosh_sequences_{people}"
            assert tuple(ours[key].value for key in keys) == expected


def test_tables_are_the_results(folder):
    results = json.loads((folder / "results.json").read_text())
    markdown = (folder / "report.md").read_text()
    for row in results["paper"]:
        assert (
            f"| {row['quantity']} | {row['paper']} | {row['ours']} | {row['verdict']} |" in markdown
        )
    for name, label in results["predictors"].items():
        for cell in results["cells"].values():
            if "mesh" in cell.get(name, {}):
                assert f"| {label} | {cell[name]['mesh']['r2'] + 0.0:.3f} |" in markdown


def test_the_autoencoders_figure_has_the_built_widths(folder):
    manifest = read_artifact(folder.parent / "train-ae").manifest
    sizes = sizes_of(manifest["architecture"]["widths"])
    assert sizes[:3] == [(6890, 3), (6890, 4), (6890, 9)]
    linear = sum(a * b + b for (_, a), (_, b) in pairwise(sizes[:3]))
    thinning = sum(a * b + b for (a, _), (b, _) in pairwise(sizes[2:]))
    widening = sum(a * b + a for (a, _), (b, _) in pairwise(sizes[2:]))
    backwards = sum(a * b + a for (_, a), (_, b) in pairwise(sizes[:3]))
    code = sizes[-1][0] * sizes[-1][1]
    latent = 100 * code + 100 + 100 * code + code
    total = linear + thinning + widening + backwards + latent
    assert total == manifest["parameters"]["mesh_autoencoder"]


def verdict_of(page: str) -> list[str]:
    """The lines of the table below the heading Verdict."""
    part = page.partition("## Verdict\n\n")[2]
    return part.partition("\n\n")[0].splitlines()


def test_both_pipelines_stand_side_by_side_first(folder):
    results = json.loads((folder / "results.json").read_text())
    page = (folder / "report.md").read_text()
    head, _, *rows = verdict_of(page)
    assert [text.strip() for text in head.split(" | ")[1:]] == [
        "held out, `50004_one_leg_jump`",
        "known person, unseen motion",
        "new person, unseen motion |",
    ]
    cells = ("validation", "known_person_unseen_motion", "new_person_unseen_motion")
    names = ["dsnet_small", "dsnet_other", "smpl", "dsnet_plus", "smpl_best"]
    assert len(rows) == len(names)
    for row, name in zip(rows, names, strict=True):
        label, *shown = row.strip("| ").split(" | ")
        found = [results["cells"][cell][name]["mesh"] for cell in cells]
        expected = [f"{one['mean_mm']:.2f} mm" for one in found]
        if name.startswith("smpl"):
            assert label.startswith("*SMPL alone, as `")
        else:
            assert label == results["predictors"][name]
            r2 = [f"✓ {one['r2'] + 0.0:.2f}" for one in found]
            expected = [f"{score}, {mm}" for score, mm in zip(r2, expected, strict=True)]
        assert shown == expected


def test_farther_in_the_mean_is_a_cross_whatever_r2_says(folder):
    def farther(results):
        mesh = results["cells"]["validation"]["dsnet_small"]["mesh"]
        mesh["mean_mm"] = results["cells"]["validation"]["smpl"]["mesh"]["mean_mm"] + 1
        mesh["r2"] = 0.25
        del results["cells"]["validation"]["dsnet_other"]["mesh"]

    page = page_of(folder, farther)
    _, _, small, other, *_ = verdict_of(page)
    assert small.split(" | ")[1].startswith("✗ 0.25, ")
    assert other.split(" | ")[1] == "-"
    html = render_html(page, folder, title="", banner="")
    assert '<b class="farther">✗</b> 0.25, ' in html
    assert '<b class="nearer">✓</b> ' in html


def test_the_page_names_law_form_gravity_and_bodies(folder):
    bed = "Test bed: tissue law `own`, form `clean`, with gravity, female bodies."
    assert bed in (folder / "report.md").read_text()

    def capture(results):
        bed = {"tissue": "second", "form": "captured", "gravity": False, "gender": "male"}
        results["test_bed"], cell = bed, results["cells"]["new_person_unseen_motion"]
        for errors in cell.values():
            if "mesh" in errors:
                errors["moving"] = {**errors["mesh"], "r2": 0.81}
        cell["dsnet_plus"]["static"] = {**cell["dsnet_plus"]["offsets"], "r2": 0.72}

    page = page_of(folder, capture)
    assert "law `second`, form `captured`, without gravity, male bodies." in page
    part = page.partition("## Static and moving part")[2].partition("## Alignment")[0]
    assert "| new person, unseen motion | 0.99, 0.81, 0.72 | 0.89, 0.81, - |" in part
    assert "### New person, unseen motion: against the true static part, at rest" in page
    assert "Static and moving" not in (folder / "report.md").read_text()


def test_another_aligner_than_the_papers_is_a_departure(folder):
    align = read_artifact(folder.parent / "align")
    for aligner, count in (("sgd", 0), ("robust", 1)):
        align.manifest["config"]["aligner"] = aligner
        assert sum("in place of SGD" in text for text in departures({"align": align})) == count
    align.manifest["config"] |= {"aligner": "sgd", "iterate": "last", "betas_per": "sequence"}
    last, own = departures({"align": align})
    assert "last iterate" in last
    assert "its own shape" in own


def test_the_papers_words_alone_come_first(folder):
    decode = read_artifact(folder.parent / "decode")
    labels = {"dsnet_other": "Other", "dsnet_small": "Small", "dsnet_literal": "Literal"}
    decode.manifest.update(predictors=labels, default="dsnet_small")
    pipeline = Pipeline("paper", *[MotionArrays.of(decode)] * 3)
    assert list(pipeline.predictors) == ["dsnet_literal", "dsnet_small", "dsnet_other"]


@pytest.mark.parametrize(
    ("std", "said"), [(1.0, "as the autoencoder gives"), (0.5, "one standard deviation")]
)
def test_only_latents_that_were_scaled_are_called_so(folder, monkeypatch, std, said):
    stages = {path.name: read_artifact(path) for path in folder.parent.iterdir() if path != folder}
    scaling = {"scaling/latent_std": np.full(100, std, np.float32)}
    load = paper_table.load_weights
    monkeypatch.setattr(paper_table, "load_weights", lambda path: load(path) | scaling)
    assert measure(stages, "female")["latent_scale"].value == said


def test_what_is_not_the_papers_differs(folder):
    stages = {path.name: read_artifact(path) for path in folder.parent.iterdir() if path != folder}
    stages["train-ae"].manifest["autoencoder"]["cosine_decay"] = True
    rows = {row["quantity"]: row for row in compare(measure(stages, "female"))}
    assert rows["learning rate of the alignment's SGD"]["verdict"] == "same"
    rate = rows["learning rate of the autoencoder's Adam"]
    assert rate["verdict"].startswith("differs: rises and falls")
    stages["align"].manifest["config"]["aligner"] = "robust"
    rows = {row["quantity"]: row for row in compare(measure(stages, "female"))}
    for quantity in ("learning rate of the alignment's SGD", "momentum of the alignment's SGD"):
        assert rows[quantity]["ours"] == "-"
        assert rows[quantity]["verdict"].startswith("differs: aligned by `robust`")
    assert rows["SGD steps for a frame"]["ours"] == "-"


def page_of(folder, edit):
    """`report.md` as it would be with other results."""
    results = json.loads((folder / "results.json").read_text())
    edit(results)
    return render_markdown(results, [], [])


def test_an_autoencoder_that_learned_nothing_is_called_so(folder):
    assert "Training took 80.0 % of the initial error" in (folder / "report.md").read_text()
    page = page_of(folder, lambda r: r["autoencoder"]["training"].update(best_step=0))
    assert "**the code is the initial linear one**" in page
    assert "Training took" not in page
    page = page_of(folder, lambda r: r["autoencoder"]["training"].update(error_fall=0.06))
    assert "6.0 % of the initial error" in page
    assert "**the code is nearly the initial linear one**" in page


@pytest.mark.usefixtures("no_figures")
def test_a_licensed_run_has_a_report_without_truth(copied):
    bare = copied("bare", "truth")
    evaluate_run(bare)
    stage_report.main(stage_report.ReportConfig(run="bare"))
    page = (bare.path / "report" / "report.md").read_text()
    assert "distance of SMPL from the mesh" in page
    assert not {words for words in ("true mesh", "true offsets", "body part") if words in page}


@pytest.mark.parametrize("own_alignment", [False, True])
def test_the_best_pipeline_alone_has_a_report(own_alignment, copied, monkeypatch):
    """Without the paper's pipeline its tables and figures are left out."""
    best = copied("best", "encode", "infer", "decode", "train", "train-ae")
    write_best_pipeline(best.path, own_alignment=own_alignment)
    for figure in ("draw_figure1", "draw_figure7"):
        monkeypatch.setattr(stage_report, figure, lambda path, *_: path.write_bytes(b"x"))
    evaluate_run(best)
    stage_report.main(stage_report.ReportConfig(run="best"))
    page = (best.path / "report" / "report.md").read_text()
    drawn = {path.stem for path in (best.path / "report" / "figures").iterdir()}
    assert drawn == {
        "figure1_strip", "figure2_alignment", "figure6_lengths", "figure7_validation",
        "figure8_error", "figure10_spine2", "over_time", "spectrum", "loss_plus", "held_out",
    }  # fmt: skip
    assert "DSNet plus" in page
    assert "autoencoder" not in page.partition("## Every test group")[0]
    for section in ("paper's numbers", "## Autoencoder"):
        assert section not in page


def test_a_second_report_makes_nothing(folder, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(folder.parents[1]))
    monkeypatch.setattr(stage_report, "plan_figures", lambda scene: pytest.fail("drawn again"))
    stage_report.main(TINY)


def test_a_missing_stage_is_named(copied):
    half = copied("half", "train-ae")
    with pytest.raises(DsnetError, match="dsnet train-ae --run half"):
        stage_report.main(stage_report.ReportConfig(run="half"))
    assert not (half.path / "report").exists()


def test_a_report_of_less_than_there_is_or_was_is_refused(folder, tmp_path, monkeypatch, capsys):
    runs = tmp_path / "runs"
    later = shutil.ignore_patterns("decode", "truth", "evaluate", "report")
    shutil.copytree(folder.parent, runs / "both", ignore=later)
    monkeypatch.setenv("DSNET_RUNS", str(runs))
    evaluate_run(Run("both"))
    assert "is evaluated without decode, truth, which it" in capsys.readouterr().err
    for stage in ("decode", "truth"):
        shutil.copytree(folder.parent / stage, runs / "both" / stage)
    with pytest.raises(DsnetError, match=r"made without align, .*decode.*truth.*`dsnet evaluate"):
        stage_report.main(TINY)
    evaluate_run(Run("both"))
    assert not capsys.readouterr().err
    shutil.rmtree(runs / "both" / "decode")
    with pytest.raises(DsnetError, match=r"without 'decode'.*`dsnet decode --run both`"):
        stage_report.main(TINY)
    assert not (runs / "both" / "report").exists()


@pytest.mark.parametrize(
    "name",
    [
        "<script>alert(1)</script>",
        "![x](http://a.example/c.png)",
        "![x](figures/../../x.png)",
        "[x](javascript:alert(1))",
        '"><img src=x onerror=alert(1)>',
    ],
)
def test_names_become_neither_scripts_nor_pictures_from_elsewhere(
    tmp_path: Path, name: str
) -> None:
    page = render_html(f"| a |\n|---|\n| {name} |\n", tmp_path, title=name, banner=name)
    for forbidden in ("<script>alert", "<img", 'href="javascript'):
        assert forbidden not in page
