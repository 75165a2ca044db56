"""The page in Firefox: what `test_browser.py` asks of Chromium, of a second hand's engine."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from bridge.cli import main
from bridge.motion.readers.amass import sample_path
from bridge.view.page import serving
from tests.bridge.view.pages import TORN, Shown, dropped, packaged, predicted_m
from tests.bridge.view.test_browser import BETAS, CLOSE_M
from tools.headless_firefox import FirefoxPage, firefox, why_missing

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(why_missing() is not None, reason=why_missing() or ""),
]


@pytest.fixture(scope="module")
def page() -> Iterator[FirefoxPage]:
    with firefox() as found:
        yield found


@pytest.mark.parametrize("gender", ["female", "male"])
def test_bodies_are_those_of_predict_after_any_jump_in_any_shape(page, tmp_path, gender):
    motion = tmp_path / "a.npz"
    with np.load(sample_path("dancing")) as sample:
        np.savez(motion, **{**sample, "gender": np.array(gender)})
    with serving(packaged(motion), 0) as address:
        page.goto(address)
        shown = Shown(page)
        expected_m = predicted_m(motion)
        for frame in (len(expected_m) - 1, 0, 131):
            found_m = shown.vertices_m("dsnet_plus", frame)
            np.testing.assert_allclose(found_m, expected_m[frame], atol=CLOSE_M)
        page.evaluate("(betas) => page.person(betas)", BETAS)
        expected_m = predicted_m(motion, betas=",".join(map(str, BETAS)))
        found_m = shown.vertices_m("dsnet_plus", 60)
        np.testing.assert_allclose(found_m, expected_m[60], atol=CLOSE_M)
        assert page.errors == []


def test_what_plays_is_what_rests_and_a_file_dropped_onto_it_plays(page, tmp_path):
    with serving(packaged(), 0) as address:
        page.goto(address)
        shown = Shown(page)
        shown.surveyed()
        shown.set(colouring="size")
        assert page.evaluate(TORN, 12) == 0
        (tmp_path / "a.bvh").write_bytes(b"HIERARCHY\n")
        assert "need Python" in dropped(shown, tmp_path / "a.bvh")
        page.set_input_files("#file", str(sample_path("walking")))
        shown.until(f"page.motion?.name === {sample_path('walking').name!r}")
        expected_m = predicted_m(sample_path("walking"), "embedded:female")
        found_m = shown.vertices_m("dsnet_plus", 30)
        np.testing.assert_allclose(found_m, expected_m[30], atol=CLOSE_M)
        assert page.errors == []


def test_a_file_opens_from_a_disk(page, tmp_path):
    out = tmp_path / "a.html"
    main(["export", "--to", "html", "--motion", "sample:jumping_jacks", "--out", str(out)])
    page.goto(out.as_uri())
    found_m = Shown(page).vertices_m("dsnet_plus", 100)
    expected_m = predicted_m("sample:jumping_jacks")[100]
    np.testing.assert_allclose(found_m, expected_m, atol=CLOSE_M)
    asked = "() => fetch('https://example.org/').then(() => 'sent', () => 'kept')"
    assert page.evaluate(asked) == "kept"
    assert [one for one in page.errors if "example.org" not in one] == []
