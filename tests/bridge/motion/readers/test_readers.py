"""A folder of AMASS or of BVHs as it is downloaded: motions are found, what is none is counted."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from bridge import DsnetError
from bridge.motion import load_motion
from bridge.motion.readers import (
    READERS,
    MotionReader,
    PeopleOfFolders,
    find_motion_files,
    format_of,
    subject_and_motion,
)
from bridge.motion.sequences import is_real_motion
from tests.forged.amass import load_as_it_lies, save, shape, smplh, smplx
from tests.pages import python_blocks


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two releases of MoSh, one of D-FAUST, and a body model that lies beside them."""
    save(tmp_path / "MPI_mosh/50004/kicking_poses.npz", smplh())
    save(tmp_path / "MPI_mosh/50004/shape.npz", shape())
    save(tmp_path / "MPI_mosh/50002/kicking_poses.npz", smplh(), gender=np.bytes_(b"male"))
    save(tmp_path / "MoSh/50004/kicking_stageii.npz", smplx())
    save(tmp_path / "MoSh/50020/basketball_stageii.npz", smplx(), gender="neutral")
    save(tmp_path / "MoSh/50020/neutral_stagei.npz", shape())
    save(tmp_path / "DFaust_67/50004/50004_hips_poses.npz", smplh())
    save(tmp_path / "smplh/female/model.npz", {"v_template": np.zeros((6890, 3))})
    return tmp_path


def names(motions: list[Path], folder: Path) -> list[str]:
    return [path.relative_to(folder).as_posix() for path in motions]


def test_motions_are_found_and_the_rest_is_counted(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = find_motion_files(folder, "female", existing=["50004_hips", "50004_punching"])
    assert names(found, folder) == [
        "MPI_mosh/50004/kicking_poses.npz",
        "MoSh/50020/basketball_stageii.npz",
    ]
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "2 motions; left out: " in said
    for part in ("3 without poses", "1 of male bodies", "2 of motions already there"):
        assert part in said


def test_what_mosh_calls_like_dyna_is_another_recording(tmp_path: Path) -> None:
    """MPI_mosh has `50004/hips` too, not Dyna's; the releases differ by a space in names."""
    save(tmp_path / "DFaust_67/50004/50004_hips_poses.npz", smplh())
    save(tmp_path / "MPI_mosh/50004/hips_poses.npz", smplh())
    save(tmp_path / "MPI_mosh/50020/salsa 1_poses.npz", smplh())
    save(tmp_path / "MoSh/50020/salsa_1_stageii.npz", smplx())
    found = find_motion_files(tmp_path, "female", existing=["50004_hips"])
    assert names(found, tmp_path) == [
        "MPI_mosh/50004/hips_poses.npz",
        "MPI_mosh/50020/salsa 1_poses.npz",
    ]


def test_a_list_chooses_by_path_or_by_name(folder: Path, tmp_path: Path) -> None:
    """In the order of paths, once each; who has the other gender is left out as ever."""
    save(folder / "MPI_mosh/50020/salsa 1_poses.npz", smplh())
    listed = tmp_path / "women.txt"
    listed.write_text(
        "# Table 1\n\n50020_salsa 1\n./MPI_mosh/50004/kicking_poses.npz  # SMPL-H's\n"
        "50020_salsa_1\n50002_kicking\r\n",
        encoding="utf-8",
    )
    found = find_motion_files(folder, "female", listed=listed)
    assert names(found, folder) == [
        "MPI_mosh/50004/kicking_poses.npz",
        "MPI_mosh/50020/salsa 1_poses.npz",
    ]
    assert len(find_motion_files(folder, "neutral", listed=listed)) == 3


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b"50004_kicking\n50004_kickin\n", "line 2: '50004_kickin'; .* mean '50004_kicking'"),
        (b"MPI_mosh/50004/kicking.npz", "mean 'MPI_mosh/50004/kicking_poses.npz'"),
        (b"# none\n\n", "which names nothing"),
        (b"\xff\xfe\x00", "cannot be read"),
        (None, "cannot be read"),
    ],
)
def test_a_list_of_what_is_not_there_is_refused(
    folder: Path, tmp_path: Path, text: bytes | None, words: str
) -> None:
    listed = tmp_path / "women.txt"
    if text is not None:
        listed.write_bytes(text)
    with pytest.raises(DsnetError, match=words):
        find_motion_files(folder, "female", listed=listed)


def test_the_body_decides_whose_motions_are_kept(folder: Path) -> None:
    male = names(find_motion_files(folder, "male"), folder)
    assert male == ["MPI_mosh/50002/kicking_poses.npz", "MoSh/50020/basketball_stageii.npz"]
    assert len(find_motion_files(folder, "neutral")) == 4


def test_bvhs_are_motions_of_everybody(tmp_path: Path) -> None:
    """Which are not read before they are used; only a second one of a name is left out."""
    save(tmp_path / "CMU/05/05_06_poses.npz", smplh(), gender="male")
    for name in ("05/05_06.bvh", "05/05_07.bvh", "more/05_07.bvh"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("HIERARCHY")
    found = names(find_motion_files(tmp_path, "female"), tmp_path)
    assert found == ["05/05_06.bvh", "05/05_07.bvh"]
    assert len(find_motion_files(tmp_path, "neutral")) == 2


def test_nothing_is_said_when_nothing_is_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save(tmp_path / "50004/kicking_poses.npz", smplh())
    assert len(find_motion_files(tmp_path, "female")) == 1
    assert capsys.readouterr().err == ""


def test_a_folder_without_motions_is_refused(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "absent"):
        with pytest.raises(DsnetError, match=r"no \.npz or .* or \.bvh or .* and no motion"):
            find_motion_files(path, "female")
    save(tmp_path / "shape.npz", shape())
    save(tmp_path / "a_poses.npz", smplh())
    with pytest.raises(DsnetError, match="1 of female bodies, 1 without poses and no motion"):
        find_motion_files(tmp_path, "male")


def test_a_damaged_file_is_named(folder: Path) -> None:
    path = folder / "MoSh" / "50020" / "half_stageii.npz"
    path.write_bytes((folder / "MPI_mosh/50004/shape.npz").read_bytes()[:200])
    with pytest.raises(DsnetError, match=r"half_stageii\.npz, which does not load"):
        find_motion_files(folder, "female")


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("mosh/50004_kicking_poses.npz", ("50004", "kicking")),
        ("MPI_mosh/50020/side_to_side_hopping_poses.npz", ("50020", "side_to_side_hopping")),
        ("MPI_mosh/50020/misc_stageii.npz", ("50020", "misc")),
        ("DFaust_67/50004/50004_hips_poses.npz", ("50004", "hips")),
        ("ACCAD/Female1/A1 - Stand_poses.npz", ("Female1", "A1 - Stand")),
        ("cmu/05_06.bvh", ("05", "06")),
    ],
)
def test_names_of_corpus_and_of_amass(path: str, expected: tuple[str, str]) -> None:
    assert subject_and_motion(Path(path)) == expected


def test_people_of_one_name_are_told_apart_by_their_shape() -> None:
    anna, bea, carl = (np.full(10, value) for value in (0.5, -1.0, 2.0))
    given = (anna, bea, anna, carl, bea, 3 * anna, -carl)
    # "flat-4" is a folder's name too, and its person is one of those of "flat".
    shapes = {"50004": carl, "flat-4": -carl}
    people, found = PeopleOfFolders(shapes), []
    for betas in given:
        name = people.of_shape("flat", betas)
        shapes.setdefault(name, betas)
        found.append(name)
    assert found == ["flat", "flat-2", "flat", "flat-3", "flat-2", "flat-5", "flat-4"]
    for name, betas in zip(found, given, strict=True):
        np.testing.assert_array_equal(shapes[name], betas)


def test_a_new_format_is_the_file_and_the_line_that_contributing_shows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (block,) = [block for block in python_blocks("CONTRIBUTING.md") if "def read(" in block]
    module = ModuleType("text")
    exec(block, module.__dict__)
    monkeypatch.setitem(READERS, "text", MotionReader((".txt",), module.read))
    walking = load_motion("sample:walking")
    lying = load_as_it_lies("sample:walking").theta
    (tmp_path / "anna").mkdir()
    path = tmp_path / "anna" / "walk.txt"
    np.savetxt(path, lying)
    np.testing.assert_allclose(load_motion(path).theta, walking.theta, atol=1e-9)
    assert find_motion_files(tmp_path, "female") == [path]
    assert format_of(path) == "text"
    assert is_real_motion("50004_text_walk")
    with pytest.raises(DsnetError, match=r"no \.npz or .* or \.txt and no motion"):
        find_motion_files(tmp_path / "nowhere", "female")
