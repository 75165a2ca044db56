"""Files of motions: one line a format, and which files of a folder are motions.

A new format is a module here and its line in `READERS`. They are tried in this order;
what none of them reads is refused by its name.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from itertools import count
from os.path import isfile
from pathlib import Path
from typing import NamedTuple

from numpy.typing import NDArray

from bridge.errors import DsnetError, notify
from bridge.motion.motion import AS_IT_SAYS, HowRead, Motion
from bridge.motion.readers import amass, bvh, fbx, gltf, joints, pickles
from bridge.motion.readers.listed import listed_files


class MotionReader(NamedTuple):
    """Who reads the files of one format."""

    suffixes: tuple[str, ...]
    """Of its files, in small letters."""
    read: Callable[[Path, HowRead], Motion]
    """Reads and checks one; `DsnetError` if it is missing or holds no usable motion."""
    gender_of: Callable[[Path], str | None] = lambda _: "unknown"
    """Whose motion a file is; None if it is none. As few bytes as possible are read."""
    ending: str = ""
    """Of its files' names, before the suffix."""
    is_smpl_family: Callable[[Path], bool] = lambda _: False
    """Whether a file is of SMPL's family, with its poses and perhaps betas, and not of an embedded
    body, of a file that holds a motion."""

    def knows(self, path: Path) -> bool:
        """Whether a file is of this format, by its name."""
        return path.suffix.lower() in self.suffixes and path.stem.lower().endswith(self.ending)


OF_SKELETONS = ("bvh", "fbx", "gltf")
"""Those whose joints have names."""
READERS = {
    "amass": MotionReader(
        (".npz", ".smpl"), amass.read, amass.gender_of, is_smpl_family=amass.is_smpl_family
    ),
    "bvh": MotionReader((".bvh",), bvh.read),
    "fbx": MotionReader((".fbx",), fbx.read),
    "gltf": MotionReader((".glb", ".gltf", ".vrm", ".vrma"), gltf.read, gltf.gender_of),
    "moshpp": MotionReader(
        (".pkl",), pickles.read, pickles.gender_of, pickles.OF_MOSH, lambda _: True
    ),
    "video": MotionReader(
        (".pkl", ".pickle", ".pt", ".pth"),
        pickles.read,
        pickles.gender_of,
        is_smpl_family=lambda _: True,
    ),
    "joints": MotionReader(
        (".npy",), joints.read, joints.gender_of, is_smpl_family=joints.is_smpl_family
    ),
}
"""By the names that a synthetic corpus's motions begin with if real people made them."""


def format_of(path: Path) -> str | None:
    """Whose file it is, of `READERS`; None of no reader's."""
    if str(path).startswith(amass.SAMPLE_PREFIX):
        return "amass"
    return next((name for name, one in READERS.items() if one.knows(path)), None)


def read_motion_file(path: Path, how: HowRead = AS_IT_SAYS) -> Motion:
    """A motion as its file holds it, whatever the format, at the file's rate and with its vertical.

    `DsnetError` if the file is missing, is of no format that is read, or holds no usable
    motion.
    """
    name = format_of(path)
    if how.joint_map and name not in OF_SKELETONS:
        raise DsnetError(
            f"--joint-map with {path}",
            "it with a BVH, FBX or glTF, whose joints have names",
            "Leave it out.",
        )
    if how.person not in (None, 1) and name in OF_SKELETONS:
        flaw = f"--person {how.person} with {path}, of whose skeletons the first person's is read"
        raise DsnetError(flaw, "it with a file of SMPL's arrays", "Leave it out.")
    if name is not None:
        return READERS[name].read(path, how)
    # Of a name that is too long pathlib's raises.
    if not isfile(path):  # noqa: PTH113
        return amass.read(path, how)  # which says that there is none, or that it is a folder
    raise DsnetError(
        f"{path}, a file of type {path.suffix or 'unknown'}, which is not read",
        "AMASS's kind (.npz, .smpl, .pkl, .pt), BVH, FBX, glTF, or places of joints (.npy)",
        "Unpack it, or export one of these.",
    )


def files_below(folder: Path) -> list[Path]:
    """Those whose names are of a format that is read, in order of path."""
    return sorted(path for path in folder.rglob("*") if path.suffix.lower() in _suffixes())


def stated_gender(path: Path) -> str | None:
    """Whose motion one of these is; None of what holds none, as AMASS's `shape.npz`.

    As few bytes as possible are read; `DsnetError` if the file is damaged.
    """
    name = format_of(path)
    return READERS[name].gender_of(path) if name else None


def is_smpl_family(path: Path) -> bool:
    """Whether one of these is a motion of SMPL's family, whose vertices and betas are SMPL's; not
    of an embedded body, as this project's own files. A damaged file is none."""
    name = format_of(path)
    try:
        return (
            name is not None
            and stated_gender(path) is not None
            and READERS[name].is_smpl_family(path)
        )
    except DsnetError:
        return False


def _suffixes() -> list[str]:
    return [suffix for reader in READERS.values() for suffix in reader.suffixes]


def find_motion_files(
    folder: Path, gender: str, existing: Iterable[str] = (), listed: Path | None = None
) -> list[Path]:
    """The motions below `folder` that a body model of `gender` can follow, in order of path.

    Left out, with one line on stderr that counts them: files without `poses` (`shape.npz`,
    `*_stagei.npz`, body models); people of the other gender, whose shape coefficients mean
    something else; second copies (SMPL-H beside SMPL-X); and the very motions of `existing`, which
    `DFaust` holds of Dyna's meshes and names `50004/50004_hips`. MoSh's `50004/hips` is another
    recording of what Dyna's `50004_hips` shows. A text file `listed` names those that are meant
    (`listed_files`).
    """
    other = {"female": "male", "male": "female"}.get(gender)
    already, taken, motions, left_out = set(existing), set[str](), [], Counter[str]()
    names = {path: "_".join(subject_and_motion(path)) for path in files_below(folder)}
    chosen = listed_files(listed, folder, names) if listed else names
    for path in (path for path in names if path in chosen):
        # Where one release has a space, the other has an underscore.
        name = names[path].replace(" ", "_")
        stated = stated_gender(path)
        if stated is None:
            # Other pickles and arrays than motions are everywhere.
            left_out.update(["without poses"] * (path.suffix in READERS["amass"].suffixes))
        elif stated == other:
            left_out[f"of {other} bodies"] += 1
        elif name in taken or (name in already and names_its_subject(path)):
            left_out["of motions already there"] += 1
        else:
            taken.add(name)
            motions.append(path)
    counts = ", ".join(f"{number} {why}" for why, number in left_out.items())
    if not motions:
        counts = counts or f"no {' or '.join(_suffixes())}"
        raise DsnetError(
            f"--amass {folder}, with {counts} and no motion",
            f"a folder of motions of {gender} bodies, AMASS's or BVH",
            "Check the path, or leave --amass out.",
        )
    if left_out:
        notify(f"{folder}: {len(motions)} motions; left out: {counts}")
    return motions


def subject_and_motion(path: Path) -> tuple[str, str]:
    """Who does what: `50004_kicking_poses.npz`, `05_06.bvh`, AMASS's `50004/kicking_poses.npz`."""
    stem = path.stem.removesuffix("_poses").removesuffix("_stageii")
    if not names_its_subject(path):
        return path.parent.name, stem
    subject, _, motion = stem.partition("_")
    return subject, motion


def names_its_subject(path: Path) -> bool:
    """Whether a file's own name begins with a subject's number, as D-FAUST's and CMU's do."""
    subject, _, motion = path.stem.partition("_")
    return subject.isdecimal() and motion not in ("", "poses", "stageii")


class PeopleOfFolders:
    """Who is who where everybody has the folder's name, as in a folder without subfolders.

    What a file says of its person is the shape. The second person is called `name-2`, and so on.

    Parameters
    ----------
    shapes : (10,) by name; others may be added, none may change.
    """

    def __init__(self, shapes: Mapping[str, NDArray]) -> None:
        self._shapes = shapes
        # By folder's name, who has which shape: a folder may hold thousands of people.
        self._names: dict[str, dict[tuple[float, ...], str]] = {}

    def of_shape(self, name: str, betas: NDArray) -> str:
        """Who is called `name` and has the shape `betas` (10,), or a new name."""
        names, shape = self._names.setdefault(name, {}), tuple(betas.tolist())
        for number in count(len(names) + 1):
            if shape in names:
                break
            one = name if number == 1 else f"{name}-{number}"
            if one not in self._shapes:
                return one
            names.setdefault(tuple(self._shapes[one].tolist()), one)
        return names[shape]
