"""The body model file in a folder that fits a motion, in the layouts of smplx and AMASS.

`smpl/SMPL_FEMALE.pkl`, `smplh/female/model.npz`, `smpl/models/basicmodel_f_...pkl`: gender stands
in names alone, the kind in names or in the file.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from bridge.body.containers import refused
from bridge.body.model_data import GENDERS, KIND_OF_JOINTS, Kind
from bridge.body.smpl_files import gender_in_path, load_smpl_file
from bridge.runs.untrusted import DAMAGE, open_npz

_SUFFIXES = (".npz", ".pkl", ".npy")
_MOST_FILES = 20_000
# fmt: off
_NO_BODIES = {
    "mano", "flame", "star", "supr", "skel", "smal", "dmpl", "dmpls", "hand", "hands", "kid",
    "prior", "template", "to", "uv", "vposer", "texture", "poses", "stagei", "stageii", "shape",
}
# fmt: on
"""Words of other files that lie beside bodies."""
_NEXT_BEST: dict[str | None, tuple[Kind, ...]] = {
    None: ("smpl", "smplh", "smplx"),
    "smpl": ("smpl", "smplh", "smplx"),
    "smplh": ("smplh", "smpl", "smplx"),  # of one space of shapes
    "smplx": ("smplx", "smplh", "smpl"),
}
_KIND_WORDS: dict[str, Kind] = {
    "smpl": "smpl", "basicmodel": "smpl", "smplh": "smplh", "smplx": "smplx",
}  # fmt: skip


class _Body(NamedTuple):
    path: Path
    gender: str
    kind: str | None


def find_body_file(folder: Path, gender: str | None, kind: str | None) -> tuple[Path, str]:
    """The file for a motion of `gender` and of a body of `kind`, and a line that says which.

    Raises
    ------
    DsnetError
        If there is none of that gender. Who is of no known gender gets a neutral body, or the
        first there is.
    """
    bodies = sorted(_bodies_below(folder), key=lambda body: _order(body.path))
    if not bodies:
        names = "SMPL_FEMALE.pkl, smplh/female/model.npz or the like"
        raise refused(folder, "a folder without a body model", names, "Check the path")
    there = sorted({body.gender for body in bodies})
    wanted = gender if gender in GENDERS else None
    if wanted is None:
        wanted = next(one for one in ("neutral", *GENDERS, "unknown") if one in there)
    elif wanted not in there and there == ["unknown"]:
        wanted = "unknown"
    chosen = [body for body in bodies if body.gender == wanted]
    if not chosen:
        files = ", ".join(str(body.path.relative_to(folder)) for body in bodies[:6])
        remedy = "Name a file itself, or another --gender"
        raise refused(folder, f"no {wanted} body in it", f"one of {files}", remedy)
    known = [body._replace(kind=body.kind or _kind_inside(body.path)) for body in chosen]
    best = min(known, key=lambda body: _NEXT_BEST[kind].index(body.kind or "smplx"))
    file = best.path.relative_to(folder)
    why = f" for a motion of {kind or 'any kind'}, {gender or 'unknown'}"
    return best.path, f"{file} of {folder} is the body{why}"


def _bodies_below(folder: Path) -> Iterator[_Body]:
    seen = 0
    for below, folders, names in os.walk(folder):
        folders[:] = [name for name in folders if not name.startswith((".", "__"))]
        for name in names:
            seen += 1
            if seen > _MOST_FILES:
                files = f"a folder of more than {_MOST_FILES} files"
                raise refused(folder, files, "one of body models", "Name their folder")
            path = Path(below, name)
            if name.startswith(".") or path.suffix.lower() not in _SUFFIXES:
                continue
            words, name_words = _words(path.relative_to(folder)), {*_words(Path(name))}
            # A body by its file name is one in any folder: MANO's download has SMPL-H's.
            judged = name_words if name_words & _KIND_WORDS.keys() else {*words}
            if not _NO_BODIES & judged:
                kinds = [_KIND_WORDS[word] for word in words if word in _KIND_WORDS]
                yield _Body(path, gender_in_path(path), kinds[-1] if kinds else None)


def _words(path: Path) -> list[str]:
    return re.split(r"[^a-z0-9]+", str(path.with_suffix("")).lower())


def _order(path: Path) -> tuple[int, int, str]:
    return len(path.parts), _SUFFIXES.index(path.suffix.lower()), str(path)


def _kind_inside(path: Path) -> str | None:
    """The kind of a body whose name does not say it."""
    try:
        with open_npz(path) as archive:
            return KIND_OF_JOINTS.get(archive["weights"].shape[-1])
    except DAMAGE:
        return load_smpl_file(path).kind
