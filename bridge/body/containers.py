"""Named fields in a file of any of the containers in which bodies are kept, by its first bytes.

Archives of NumPy, pickles, dictionaries in a `.npy`, torch files and safetensors are read; what
people take for one of them (a web page, git-lfs's pointer, an archive to unpack) is told by name.
DMPL's directions, in which a soft body moves, come in the same way.
"""

from __future__ import annotations

import math
import pickle
import re
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray
from safetensors import safe_open

from bridge.body.pickled_arrays import MOST_BYTES, Record, whole_numbers
from bridge.body.safe_pickle import STORAGES, Global, load_restricted, load_restricted_item
from bridge.errors import DsnetError
from bridge.paper import DMPL_DIRECTIONS, N_VERTICES
from bridge.runs.untrusted import (
    NpyHeader,
    UntrustedNpz,
    damage_refused,
    open_npz,
    open_regular,
)

MOST_FILE_BYTES = 1 << 30
_MOST_NUMBERS = 1 << 27
"""Of all arrays that are read: as float64 they take a gigabyte."""
_MOST_TENSORS = 10_000
"""Of a list in a torch file."""
MODELS = "They are at smpl.is.tue.mpg.de, mano.is.tue.mpg.de and smpl-x.is.tue.mpg.de"
TEXTURE = "vt", "ft"
"""Fields that a file may have for pictures; nobody needs them."""
_AGAIN = "Download the file again"
_UNPACK = "Unpack it, and pass one body of it (.npz or .pkl, of one gender)"
_PICKLE = rb"\x80[\0-\x05]|[(}\])cN]|P[^\n]*\n"
_TEXT = rb"(?=[ -~]*[ :{])[\t\n\r -~]+\Z"
_STRANGERS: tuple[tuple[bytes, str, str], ...] = (
    (rb"\Z", "an empty file", _AGAIN),
    (rb"\0{64}", "zeros, no body: a download that broke off", _AGAIN),
    (rb"version https://git-lfs|/annex/objects/|[./]*/\.git/annex",
     "git-lfs's or git-annex's pointer to a file, not the file",
     "Run `git lfs pull` or `git annex get` in the repository that it lies in"),
    (rb"(\xef\xbb\xbf)?\s*<", "a web page, saved under the file's name",
     "Sign in at the site that has it, and download it again"),
    (rb"\x1f\x8b|x[\x01\x5e\x9c\xda]|BZh|\xfd7zXZ|7z\xbc\xaf|Rar!|.{257}ustar",
     "an archive, not unpacked", _UNPACK),
    (rb"Kaydara FBX|; FBX", "a scene (.fbx)", "Pass the model file that it was made from"),
    (rb"glTF|BLENDER|ply|v -?\d|o \w|mtllib|# Blender", "a mesh or scene",
     "Pass the model file that it was made from"),
    (rb"\x89HDF", "an HDF5 file", "Meshes of Dyna and D-FAUST go to --dyna"),
    (rb"\x80\x02\x8a\nl\xfc\x9cF", "an old file of PyTorch's", "Save its arrays as .npz"),
)  # fmt: skip
"""What begins so, what it is, and what helps."""


def read_fields(path: Path, wanted: Mapping[str, int]) -> Mapping[str, Any]:
    """All fields by name, those of `wanted` with their values: arrays, of at most
    so many bytes, or what `bridge.body.pickled_arrays.as_array` makes one of.

    Raises
    ------
    DsnetError
        If the file is of another kind; `bridge.runs.untrusted.DAMAGE` or `RecursionError` if it is
        damaged.
    """
    with open_regular(path, MOST_FILE_BYTES) as file:
        start = file.read(min(512, int(file.largest_read)))
        file.seek(0)
        if start[:2] == b"PK":
            return _of_zip(path, file, wanted)
        if start[:6] == b"\x93NUMPY":
            return _dictionary(path, _of_npy(path, file))
        if start[8:9] == b"{" and start[7:8] == b"\0":
            return _of_tensors(path)
        for pattern, what, remedy in _STRANGERS:
            if re.match(pattern, start, re.DOTALL | re.IGNORECASE):
                raise refused(path, what, remedy=remedy)
        if re.match(_TEXT, start):
            line = start.splitlines()[0][:60].decode()
            raise refused(path, f"text ({line!r}), as of an error page", remedy=_AGAIN)
        if not re.match(_PICKLE, start):
            raise refused(path, f"a file of no kind that is read (it begins with {start[:12]!r})")
        return _dictionary(path, load_restricted(file))


def refused(
    name: str | Path,
    received: str,
    expected: str = "an SMPL, SMPL-H or SMPL-X model (.npz or .pkl)",
    remedy: str = MODELS,
) -> DsnetError:
    """The line that says why a body is not taken."""
    return DsnetError(f"body model {name}: {received}", expected, remedy)


def _of_zip(path: Path, file: IO[bytes], wanted: Mapping[str, int]) -> Mapping[str, Any]:
    try:
        with open_npz(path, MOST_FILE_BYTES) as archive:
            if len(archive):
                if set(archive) == {"arr_0"} and archive["arr_0"].dtype.hasobject:
                    return _dictionary(path, _object(archive, "arr_0"))
                return npz_fields(archive, wanted)
            names = [name for name in archive.others if not re.search(r"__MACOSX|/\._", name)]
    except zipfile.BadZipFile as error:
        raise refused(path, f"an archive that is cut short ({error})", remedy=_AGAIN) from error
    if any(name.endswith("data.pkl") for name in names):
        return _dictionary(path, load_torch(file))
    if inside := [name for name in names if name.endswith((".npz", ".pkl"))]:
        raise refused(path, "an archive, not unpacked", remedy=f"Unpack it, and pass {inside[0]}")
    raise refused(path, f"an archive without a body model ({', '.join(names[:3])})")


def _of_tensors(path: Path) -> Mapping[str, NDArray]:
    """Those whose types NumPy has."""
    with safe_open(path, "numpy") as file:
        types = {name: file.get_slice(name).get_dtype() for name in file.keys()}  # noqa: SIM118
        known = re.compile(r"F(16|32|64)|[IU]\d+|BOOL").fullmatch
        return {name: file.get_tensor(name) for name, one in types.items() if known(one)}


def npz_fields(archive: UntrustedNpz, wanted: Mapping[str, int]) -> Mapping[str, Any]:
    """As `read_fields`, of an `.npz`: of what is wanted nothing is read before all is checked."""
    headers = {name: archive[name] for name in archive if name in wanted}
    headers = {n: one for n, one in headers.items() if n not in TEXTURE or not one.dtype.hasobject}
    plain = {name: one for name, one in headers.items() if not one.dtype.hasobject}
    for name in plain:
        archive.check(name, wanted[name])
    if (total := sum(math.prod(header.shape) for header in plain.values())) > _MOST_NUMBERS:
        raise ValueError(f"{total} numbers, not at most {_MOST_NUMBERS}")
    read = {n: archive.array(n) if n in plain else _object(archive, n) for n in headers}
    return dict.fromkeys(archive) | read


def _object(archive: UntrustedNpz, name: str) -> Any:
    with archive.member(name) as stream:
        return load_restricted_item(stream)


def _of_npy(path: Path, file: IO[bytes]) -> Any:
    header = NpyHeader.read(file)
    if not header.dtype.hasobject:
        raise refused(path, f"one array of shape {header.shape}, as of vertices alone")
    file.seek(0)
    return load_restricted_item(file)


def _dictionary(path: Path, found: Any) -> Mapping[str, Any]:
    if isinstance(found, list):
        what = f"a list of {len(found)}, as results or fits are, and no model"
        raise refused(path, what, remedy="A motion goes to --motion")
    if not isinstance(found, dict):
        raise pickle.UnpicklingError(f"it holds a {type(found).__name__}, not a dictionary")
    return {
        name.decode("latin1") if isinstance(name, bytes) else str(name): value
        for name, value in found.items()
    }


def load_torch(file: IO[bytes]) -> Any:
    """What `torch.save` wrote, with arrays in place of tensors; PyTorch is not needed."""
    with zipfile.ZipFile(file) as archive:
        (inside,) = (name for name in archive.namelist() if name.endswith("data.pkl"))
        if archive.getinfo(inside).file_size > MOST_BYTES:
            raise ValueError("a pickle beyond all measure")
        with archive.open(inside) as stream:
            found = load_restricted(stream, of_torch=True)
        return _filled(found, archive, inside.removesuffix("data.pkl"), depth=4)


def _filled(value: Any, archive: zipfile.ZipFile, folder: str, depth: int) -> Any:
    if isinstance(value, dict) and depth:
        return {n: _filled(v, archive, folder, depth - 1) for n, v in value.items()}
    if isinstance(value, list) and depth:
        return [_filled(v, archive, folder, depth - 1) for v in value[:_MOST_TENSORS]]
    if (parts := _parts_of(value)) is None:
        return value
    name, dtype, begin, shape, strides = parts
    info = archive.getinfo(f"{folder}data/{name}")
    if info.file_size > MOST_BYTES or info.compress_type != zipfile.ZIP_STORED:
        raise ValueError(f"a tensor of {info.file_size} bytes")
    if len(strides) != len(shape) or math.prod(shape) * dtype.itemsize > MOST_BYTES:
        raise ValueError(f"a tensor of shape {shape}")
    numbers = np.frombuffer(archive.read(info), dtype)
    last = begin + sum((size - 1) * step for size, step in zip(shape, strides, strict=True))
    if begin < 0 or (math.prod(shape) and last >= len(numbers)):
        raise ValueError("a tensor beyond its numbers")
    if not math.prod(shape):
        return np.empty(shape, dtype)
    steps = tuple(step * dtype.itemsize for step in strides)
    return np.lib.stride_tricks.as_strided(numbers[begin:], shape, steps, writeable=False).copy()


def _parts_of(value: Any) -> tuple[str, np.dtype, int, tuple[int, ...], tuple[int, ...]] | None:
    """Of a tensor in a torch file: the name of its numbers, their type, where it begins, its shape
    and strides; None of anything else."""
    match value:
        case Record("tensor", (Record("storage", (stored,)), int(at), shape, strides, *_)):
            _, kind, name, *_ = stored
            if isinstance(kind, Global) and kind.kind in STORAGES.values():
                sizes = whole_numbers(shape), whole_numbers(strides)
                return str(name), np.dtype(f"<{kind.kind}"), at, *sizes
    return None


def load_dmpl_directions(path: str | Path) -> NDArray[np.float64]:
    """The first 8 directions (6890, 3, 8) in which a soft body moves, of DMPL's
    `dmpls/<gender>/model.npz`."""

    def refusal(error: Exception | str) -> DsnetError:
        detail = "no 'eigvec'" if isinstance(error, KeyError) else str(error)[:200]
        shape = f"({N_VERTICES}, 3, {DMPL_DIRECTIONS} or more)"
        expected = f"`eigvec` {shape} of directions that are not parallel"
        remedy = "Download DMPL (dmpls/<gender>/model.npz) again from smpl.is.tue.mpg.de."
        return DsnetError(f"DMPL {path}: {detail}", expected, remedy)

    with damage_refused(refusal), open_npz(path, MOST_FILE_BYTES) as archive:
        archive.check("eigvec", MOST_BYTES)
        eigvec = archive.array("eigvec")
    fits = eigvec.shape[:2] == (N_VERTICES, 3) and eigvec.ndim == 3 and eigvec.dtype.kind in "iuf"
    if not fits or eigvec.shape[2] < DMPL_DIRECTIONS:
        raise refusal(f"eigvec of {eigvec.dtype} in shape {eigvec.shape}")
    directions = eigvec[..., :DMPL_DIRECTIONS].astype(np.float64)
    columns = directions.reshape(-1, DMPL_DIRECTIONS)
    if not np.isfinite(columns).all() or np.linalg.matrix_rank(columns) < DMPL_DIRECTIONS:
        raise refusal("directions that are parallel, or not numbers")
    return directions
