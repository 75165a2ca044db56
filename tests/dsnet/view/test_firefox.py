"""The page in Firefox: what `test_browser.py` asks of Chromium, of a second hand's engine."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from bridge.motion.readers.amass import sample_path
from dsnet.cli import main
from tests.dsnet.view.pages import BETAS, TORN, Shown, dropped, packaged, serve
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
    with serve(packaged(motion)) as address:
        page.goto(address)
        shown = Shown(page)
        shown.moves_as_predicted(motion, -1, 0, 131)
        page.evaluate("(betas) => page.person(betas)", BETAS)
        shown.moves_as_predicted(motion, 60, betas=",".join(map(str, BETAS)))
        assert page.errors == []


def test_what_plays_is_what_rests_and_a_file_dropped_onto_it_plays(page, tmp_path):
    with serve(packaged()) as address:
        page.goto(address)
        shown = Shown(page)
        shown.surveyed()
        shown.set(colouring="size")
        assert page.evaluate(TORN, 12) == 0
        (tmp_path / "a.bvh").write_bytes(b"HIERARCHY\n")
        assert "a.bvh" in dropped(shown, tmp_path / "a.bvh")
        walk = tmp_path / "walk.bvh"
        main(["export", "--to", "bvh", "--motion", "sample:walking", "--out", str(walk)])
        page.set_input_files("#file", str(walk))
        shown.until("page.motion?.name === 'walk'")
        shown.moves_as_predicted(walk, 30)
        assert page.errors == []


def test_a_file_opens_from_a_disk(page, tmp_path):
    out = tmp_path / "a.html"
    main(["export", "--to", "html", "--motion", "sample:jumping_jacks", "--out", str(out)])
    page.goto(out.as_uri())
    Shown(page).moves_as_predicted("sample:jumping_jacks", 100)
    asked = "() => fetch('https://example.org/').then(() => 'sent', () => 'kept')"
    assert page.evaluate(asked) == "kept"
    assert [one for one in page.errors if "example.org" not in one] == []


def test_what_goes_wrong_in_a_page_is_known(page):
    page.goto("about:blank")
    before = len(page.errors)
    page.evaluate("console.error('told')")
    page.evaluate("setTimeout(() => { throw Error('thrown'); })")
    page.evaluate("new Promise((done) => setTimeout(done, 100))")
    told, thrown = page.errors[before:]
    assert told == "told"
    assert "thrown" in thrown
