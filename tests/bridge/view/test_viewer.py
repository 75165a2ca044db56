"""The whole viewer with a server in this process, but without a browser."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from bridge.body.parts import PARTS, part_weights
from bridge.body.shapes import find_shape
from bridge.errors import DsnetError
from bridge.runtime.controls import Controls
from bridge.view.performances import Performances
from bridge.view.repertoire import AS_ASKED, SMPL_ALONE, open_repertoire
from tests.bridge.view.conftest import FRAMES, JUMP

pytest.importorskip("viser", reason="viser is not installed")
from bridge.view.live_scene import BANDS
from bridge.view.selection import OVERLAID, Selection
from bridge.view.stage_view import write_recording
from bridge.view.viewer import Viewer, first_selection, record, serving


@pytest.fixture
def viewer(performances) -> Iterator[Viewer]:
    with serving("127.0.0.1", 0) as server:
        found = Viewer(server, performances)
        found.performances.worker.wait(30)
        found.draw(0.5)
        yield found


def drawn_m(viewer: Viewer, name: str) -> np.ndarray:
    """(V, 3) the vertices of a body that is shown."""
    return viewer.scene.figures[name].vertices_m.copy()


def change(viewer: Viewer, **values: float | str) -> None:
    """Move controls and draw the same frame again, when everything is computed."""
    for name, value in values.items():
        handle = getattr(viewer.panel, f"_{name}")
        handle.value = value
    viewer.draw(0.0)
    assert viewer.performances.worker.wait(30)
    viewer.draw(0.0)


def _broken(*_: object) -> None:
    raise DsnetError("no file", "one", "Pass it.")


def test_at_first_there_are_smpl_alone_the_predictor_and_the_truth(viewer):
    assert list(viewer.scene.figures) == [SMPL_ALONE, "dsnet_plus", "truth"]
    faces = viewer.performances.repertoire.body.faces
    for figure in viewer.scene.figures.values():
        meshes = [mesh for mesh in figure.bands if mesh.visible]
        corners_m = np.concatenate([mesh.vertices[mesh.faces] for mesh in meshes])
        expected_m = figure.vertices_m[faces]
        assert sorted(corners_m.tolist()) == sorted(expected_m.tolist())
        for mesh in meshes:
            assert len(mesh.vertices) == len(np.unique(mesh.faces))
    apart_m = drawn_m(viewer, "dsnet_plus") - drawn_m(viewer, SMPL_ALONE)
    assert np.abs(apart_m).max() > 1e-3


def test_time_passes_and_stops(viewer):
    before = viewer.timeline.frame
    viewer.draw(0.1)
    assert viewer.timeline.frame == before + 6
    viewer.panel._on_play(None)
    viewer.draw(0.1)
    assert viewer.timeline.frame == before + 6
    assert viewer.panel._frame.value == before + 6


def test_gain_moves_the_predicted_body_at_once_and_smpl_alone_never(viewer):
    alone, once = drawn_m(viewer, SMPL_ALONE), drawn_m(viewer, "dsnet_plus")
    viewer.panel._gain.value = 2.0
    viewer.draw(0.0)
    np.testing.assert_array_equal(drawn_m(viewer, SMPL_ALONE), alone)
    twice = drawn_m(viewer, "dsnet_plus")
    np.testing.assert_allclose(twice - alone, 2 * (once - alone), atol=1e-3)
    assert np.abs(twice - once).max() > 2e-3


def test_a_beta_moves_every_body_and_takes_the_truth_away(viewer):
    before = {name: drawn_m(viewer, name) for name in (SMPL_ALONE, "dsnet_plus")}
    viewer.panel._betas[0].value = 3.0
    change(viewer)
    for name, vertices_m in before.items():
        assert np.abs(drawn_m(viewer, name) - vertices_m).max() > 0.01
    assert not viewer.scene.figures["truth"].root.visible
    viewer.panel._on_person(None)
    change(viewer)
    np.testing.assert_array_equal(drawn_m(viewer, SMPL_ALONE), before[SMPL_ALONE])
    assert viewer.scene.figures["truth"].root.visible


def test_a_shape_by_name_sets_the_betas(viewer):
    betas = find_shape(viewer.performances.repertoire.body, ["tall"])
    viewer.panel._person.value = "tall"
    viewer.panel._on_person(None)
    change(viewer)
    np.testing.assert_allclose(viewer.panel.selection.betas, betas)
    sliders = [slider.value for slider in viewer.panel._betas]
    np.testing.assert_allclose(sliders, betas, atol=0.0051)
    change(viewer, take="50004_stand (trained on)")
    viewer.panel._on_person(None)
    np.testing.assert_allclose(viewer.panel.selection.betas, betas)


def test_a_shape_out_of_reach_is_one_line(viewer, monkeypatch):
    monkeypatch.setattr("bridge.view.performances.find_shape", _broken)
    before = viewer.panel.selection.betas
    viewer.panel._person.value = "slim"
    viewer.panel._on_person(None)
    change(viewer)
    assert "no file; expected one." in viewer.panel._status.content
    assert viewer.panel.selection.betas == before


def test_a_part_gain_moves_that_part_alone(viewer):
    body, before = viewer.performances.repertoire.body, drawn_m(viewer, "dsnet_plus")
    viewer.panel._part_gains[PARTS.index("belly")].value = 4.0
    change(viewer)
    moved_m = np.abs(drawn_m(viewer, "dsnet_plus") - before).max(axis=1)
    belly = part_weights(body)[:, PARTS.index("belly")]
    assert moved_m[belly == 0].max() == 0
    assert moved_m[belly > 0.9].max() > 1e-3


def test_a_loop_goes_on_where_it_is_and_has_no_truth(viewer):
    change(viewer, take="50004_stand (trained on)")
    viewer.timeline.go_to(FRAMES - 1)
    change(viewer, loop=True)
    # A body that stands still ends as it began: its last frame is left out.
    assert (viewer.timeline.frame, viewer.timeline.frames) == (FRAMES - 2, FRAMES - 1)
    assert not viewer.performances.worker.failed


def test_what_cannot_be_looped_stays_as_it_was(viewer, monkeypatch):
    tried = []
    monkeypatch.setattr(
        "bridge.view.performances.stage_motion", lambda *_: tried.append(1) or _broken()
    )
    change(viewer, loop=True)
    viewer.draw(0.0)
    assert "no file; expected one." in viewer.panel._status.content
    assert viewer.scene.figures["truth"].root.visible
    assert len(tried) == 1
    change(viewer, loop=False)
    assert "no file" not in viewer.panel._status.content


def test_it_starts_as_it_is_asked(performances):
    betas = (1.0, *np.zeros(9))
    controls = Controls(
        gain=7.5, part_gain=("arms=2", "hands=3"), floor="shift", shape=("betas=1" + ",0" * 9,)
    )
    repertoire = performances.repertoire
    asked = replace(repertoire, people={AS_ASKED: np.array(betas), **repertoire.people})
    started = Performances(asked)
    with serving("127.0.0.1", 0) as server:
        panel = Viewer(server, started, controls).panel
        found = panel.selection
        started.worker.stop()
    assert (found.gains.of_all, found.betas, found.floor) == (7.5, betas, "shift")
    expected = {"upper_arms": 2.0, "forearms": 2.0, "hands": 3.0}
    of_parts = dict(zip(PARTS, found.gains.of_parts, strict=True))
    assert of_parts == dict.fromkeys(PARTS, 1.0) | expected
    assert panel._person.value == AS_ASKED


def test_another_motion_begins_at_its_first_frame(viewer):
    assert viewer.timeline.frames == FRAMES - 10
    change(viewer, take="50004_stand (trained on)")
    assert (viewer.timeline.frame, viewer.timeline.frames) == (0, FRAMES)
    assert not viewer.scene.figures["truth"].root.visible


def test_bodies_stand_apart_or_in_one_another(viewer):
    def places_m() -> list[float]:
        return [float(figure.root.position[0]) for figure in viewer.scene.figures.values()]

    assert np.diff(places_m()).min() > 1.0
    change(viewer, layout=OVERLAID)
    assert places_m() == [0.0, 0.0, 0.0]


def test_everything_says_synthetic(viewer):
    assert "synthetic" in viewer.scene.figures[SMPL_ALONE]._label.text
    assert any("synthetic" in getattr(one, "text", "") for one in viewer.scene._scale)


def test_the_scale_is_in_centimetres(viewer):
    change(viewer, full_cm=1.5)
    texts = [one.text for one in viewer.scene._scale[BANDS:]]
    assert texts == ["0 cm", "0.75 cm", "1.5 cm and more", "size of offset (synthetic data)"]


def test_a_motion_that_cannot_be_read_leaves_the_last_one(viewer, monkeypatch):
    monkeypatch.setattr(viewer.performances, "want", _broken)
    change(viewer, gain=2.0)
    assert "no file; expected one." in viewer.panel._status.content
    assert viewer.scene.figures[SMPL_ALONE].root.visible


def test_a_recording_holds_the_scene_and_its_client(performances):
    selection = Selection(JUMP, performances.own_betas(JUMP), (SMPL_ALONE,))
    performances.worker.failed["elsewhere"] = DsnetError("nothing", "something", "Look away.")
    page = record(performances, selection)
    assert page.lower().startswith("<!doctype html>")
    assert "__VISER_EMBED_DATA__" in page
    assert not [line for line in page.split("<") if line.startswith(("script src", "link href"))]


def test_a_recording_is_written_whole(tmp_path, capsys):
    performances = Performances(open_repertoire(None, None), most_s=0.2)
    assert first_selection(performances).take == "dancing"
    write_recording(tmp_path / "a.html", performances)
    assert [path.name for path in tmp_path.iterdir()] == ["a.html"]
    assert "open it in any browser" in capsys.readouterr().err
