"""Pictures of moving bodies: all are committed, of sane size, synthetic, and may be shown."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from PIL import Image

from bridge import DsnetError
from tools.build_gallery import FREE_FILE, MAKERS, PICTURES, RECORDED, UNPUBLISHED, Gallery, main

ROOT = Path(__file__).parents[1]


def test_every_picture_is_there_and_no_recording_but_the_free_one() -> None:
    """Clips say of which file they are; those of the synthetic corpus are its takes'."""
    page = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
    assert {path.name for path in PICTURES.iterdir()} == set(MAKERS)
    assert set(re.findall(r"images/gallery/([\w.]+)", page)) == set(MAKERS)
    names = {}
    for path in PICTURES.glob("*.gif"):
        with Image.open(path) as clip:
            assert clip.info["comment"].startswith(b"synthetic")
            (motion,) = re.findall(rb"motion (\S+), controls", clip.info["comment"])
            names[path.name] = motion.decode()
    assert names.pop(RECORDED) == FREE_FILE
    assert not [name for name in names.values() if not re.match(r"50\d{3}_\w+_poses\.npz$", name)]


def test_others_recordings_go_where_git_does_not_look() -> None:
    assert UNPUBLISHED.relative_to(ROOT).parts[0] == "build"
    assert "build/" in (ROOT / ".gitignore").read_text(encoding="utf-8").splitlines()


@pytest.mark.parametrize("name", ["walk_poses.npz", "02_04.bvh", None])
def test_another_recording_does_not_get_into_the_pages(tmp_path: Path, name: str | None) -> None:
    file = name and tmp_path / name
    with pytest.raises(DsnetError, match=rf"expected CMU's {FREE_FILE}.*build/gallery"):
        main(Gallery(only=(RECORDED,), recording=file or None, out=tmp_path / "out"))
    assert not (tmp_path / "out").exists()
