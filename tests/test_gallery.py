"""Pictures of moving bodies: all are committed, of sane size, synthetic, and may be shown."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from PIL import Image

from bridge import DsnetError
from tools.build_gallery import FREE_FILE, MAKERS, PICTURES, RECORDED, UNPUBLISHED, Gallery, main

ROOT = Path(__file__).parents[1]
MOST_BYTES = {".gif": 3_000_000, ".png": 1_000_000}


def test_every_picture_is_there_and_on_the_page() -> None:
    page = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
    assert {path.name for path in PICTURES.iterdir()} == set(MAKERS)
    assert set(re.findall(r"images/gallery/([\w.]+)", page)) == set(MAKERS)
    assert "synthetic" in page.lower()


@pytest.mark.parametrize("name", MAKERS)
def test_a_picture_is_not_too_large_and_a_clip_says_synthetic(name: str) -> None:
    path = PICTURES / name
    assert path.stat().st_size <= MOST_BYTES[path.suffix]
    with Image.open(path) as picture:
        assert picture.size[0] <= 1200
        if path.suffix == ".gif":
            assert picture.info["comment"].startswith(b"synthetic")
            assert picture.info["loop"] == 0


def test_no_recording_but_the_free_one_is_in_the_pages() -> None:
    """Clips say of which file they are; those of the synthetic corpus are its takes'."""
    names = {}
    for path in PICTURES.glob("*.gif"):
        with Image.open(path) as clip:
            (motion,) = re.findall(rb"motion (\S+), controls", clip.info["comment"])
            names[path.name] = motion.decode()
    assert names.pop(RECORDED) == FREE_FILE
    assert not [name for name in names.values() if not re.match(r"50\d{3}_\w+_poses\.npz$", name)]


def test_the_free_recording_is_named_as_its_makers_ask() -> None:
    page = " ".join((ROOT / "docs" / "gallery.md").read_text(encoding="utf-8").split())
    for words in (
        "The data used in this project was obtained from [mocap.cs.cmu.edu]",
        "The database was created with funding from NSF EIA-0196217.",
    ):
        assert words in page


def test_others_recordings_go_where_git_does_not_look() -> None:
    assert UNPUBLISHED.relative_to(ROOT).parts[0] == "build"
    assert "build/" in (ROOT / ".gitignore").read_text(encoding="utf-8").splitlines()


@pytest.mark.parametrize("name", ["walk_poses.npz", "02_04.bvh", None])
def test_another_recording_does_not_get_into_the_pages(tmp_path: Path, name: str | None) -> None:
    file = name and tmp_path / name
    with pytest.raises(DsnetError, match=rf"expected CMU's {FREE_FILE}.*build/gallery"):
        main(Gallery(only=(RECORDED,), recording=file or None, out=tmp_path / "out"))
    assert not (tmp_path / "out").exists()
