"""Body model files of every kind that people have, forged around a person of a few hundred
vertices, the embedded body's joints in an egg of a body's size; and files that are taken for one.
"""

from __future__ import annotations

import io
import json
import pickle
import struct
import zipfile
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bridge.body import BodyModelData, load_body_model
from bridge.body.model_data import SKELETONS, Kind
from tests.forged.python2_pickle import Ch, python2_pickle, sliced

Fields = dict[str, Any]
PELVIS_M = (-0.002, -0.241, 0.029)
"""Off the origin, as in real files: else no mistake about the root's turning could show."""
_RINGS, _AROUND = 10, 16


def person(kind: Kind = "smpl", shapes: int = 10, expressions: int = 0) -> BodyModelData:
    """A body of `kind`; SMPL-X's has sockets and loose eyes."""
    rng = np.random.default_rng(len(kind))
    adult = load_body_model("embedded:female")
    ball, faces = _ball(_RINGS, _AROUND)
    joints = _joints(kind, adult.joints + PELVIS_M)
    middle = (joints.max(0) + joints.min(0)) / 2
    vertices = middle + ball * [0.8, 0.85, 0.2]
    if kind == "smplx":
        faces = faces[:-_AROUND:]  # open at the bottom
        eye, eye_faces = _ball(3, 6)
        for joint in (23, 24):
            faces = np.concatenate([faces, eye_faces + len(vertices)])
            vertices = np.concatenate([vertices, joints[joint] + 0.012 * eye])
    count = len(vertices)
    near = np.exp(-np.linalg.norm(vertices[:, None] - joints, axis=2) / 0.05)
    return BodyModelData(
        name=kind,
        source="licensed",
        gender="female",
        v_template=vertices,
        shapedirs=rng.normal(0, 0.01, (count, 3, shapes)),
        posedirs=rng.normal(0, 0.003, (count, 3, 9 * (len(joints) - 1))),
        J_regressor=sp.csr_matrix(_regressor(vertices, joints)),
        weights=near / near.sum(axis=1, keepdims=True),
        faces=faces,
        parents=np.array(SKELETONS[kind][1]),
        expressiondirs=rng.normal(0, 0.02, (count, 3, expressions)),
        hands_mean=rng.normal(0, 0.2, (30, 3)) if kind != "smpl" else None,
    )


def _ball(rings: int, around: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Unit radius, wound counter-clockwise seen from outside; the bottom's triangles come last."""
    high = np.pi * np.arange(1, rings + 1)[:, None] / (rings + 1)
    turn = 2 * np.pi * np.arange(around) / around
    ring = [np.sin(high) * np.sin(turn), np.cos(high) + 0 * turn, np.sin(high) * np.cos(turn)]
    poles = [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]
    vertices = np.concatenate([np.stack(ring, -1).reshape(-1, 3), poles])
    here, top = np.arange(around), rings * around
    beside = (here + 1) % around
    quads = [
        np.stack([r * around + a for r, a in corners], axis=1)
        for ring in range(rings - 1)
        for corners in (
            ((ring, here), (ring + 1, here), (ring + 1, beside)),
            ((ring, here), (ring + 1, beside), (ring, beside)),
        )
    ]
    cap = np.stack([0 * here + top, here, beside], axis=1)
    last = (rings - 1) * around
    foot = np.stack([0 * here + top + 1, last + beside, last + here], axis=1)
    return vertices, np.concatenate([cap, *quads, foot])


def _joints(kind: Kind, of_smpl: NDArray) -> NDArray[np.float64]:
    """Places of all joints: fingers in a row behind the wrist, jaw and eyes before the head."""
    names, parents = SKELETONS[kind]
    if kind == "smpl":
        return of_smpl
    joints = [*of_smpl[:22]]
    for number, (name, parent) in enumerate(zip(names[22:], parents[22:], strict=True)):
        side = 1 if name.startswith("left") else -1
        finger, face = [0.02 * side, 0.0, 0.01 * (number % 3)], [0.03 * side, 0.05, 0.08]
        joints.append(joints[parent] + (face if parent == 15 else finger))
    return np.array(joints)


def _regressor(vertices: NDArray, joints: NDArray) -> NDArray[np.float64]:
    """(J, V) the smallest, rows of sum one, that gives the joints."""
    ones = np.ones((1, len(vertices)))
    wanted = np.concatenate([joints, np.ones((len(joints), 1))], axis=1)
    return wanted @ np.linalg.pinv(np.concatenate([vertices.T, ones])).T


def fields_of(body: BodyModelData, dtype: Any = np.float64, root: int = 2**32 - 1) -> Fields:
    """The seven fields that matter, and hands where there are some, as the owners' files have
    them."""
    dirs = np.concatenate([body.shapedirs, body.expressiondirs], axis=2)
    parents = np.where(body.parents < 0, root, body.parents)
    made: Fields = {
        "v_template": body.v_template.astype(dtype),
        "f": body.faces.astype(np.uint32),
        "weights": body.weights.astype(dtype),
        "shapedirs": dirs.astype(dtype),
        "posedirs": body.posedirs.astype(dtype),
        "J_regressor": body.J_regressor.toarray().astype(dtype),
        "kintree_table": np.stack([parents, np.arange(len(parents))]).astype(np.int64),
    }
    if body.hands_mean is not None:
        made["hands_meanl"], made["hands_meanr"] = body.hands_mean.reshape(2, -1)
    return made


def npz(fields: Fields) -> bytes:
    file = io.BytesIO()
    np.savez(file, **fields)
    return file.getvalue()


def npy(array: NDArray) -> bytes:
    file = io.BytesIO()
    np.save(file, array, allow_pickle=True)
    return file.getvalue()


def zipped(files: dict[str, bytes]) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return file.getvalue()


def safetensors(fields: Fields) -> bytes:
    """The format's header and bytes, by its description."""
    types = {"float32": "F32", "float64": "F64", "int64": "I64"}
    header, data = {}, b""
    for name, value in fields.items():
        raw = np.ascontiguousarray(value).tobytes()
        header[name] = {"dtype": types[str(value.dtype)], "shape": list(value.shape),
                        "data_offsets": [len(data), len(data) + len(raw)]}  # fmt: skip
        data += raw
    text = json.dumps({"__metadata__": {"format": "pt"}, **header}).encode()
    return struct.pack("<Q", len(text)) + text + data


_RAGGED = {"ft": np.array([[1], [2, 3]], object), "part2num": np.array({"head": 1}, object)}
"""What nobody needs, in types that nobody wants."""


def as_buffers(fields: Fields) -> Fields:
    """Names and layouts of a PyTorch module's buffers."""
    return {
        "body.v_template": fields["v_template"],
        "body.faces_tensor": fields["f"].astype(np.int64),
        "body.lbs_weights": fields["weights"],
        "body.shapedirs": fields["shapedirs"],
        "body.posedirs": _over(fields["posedirs"]),
        "body.J_regressor": fields["J_regressor"],
        "body.parents": fields["kintree_table"][0].astype(np.int64),
        "body.betas": np.zeros((1, 10), np.float32),
    }


def _over(posedirs: NDArray) -> NDArray:
    return posedirs.reshape(-1, posedirs.shape[-1]).T


def _with(**edits: Callable[[Any], Any]) -> Callable[[Fields], Fields]:
    return lambda fields: fields | {name: edit(fields[name]) for name, edit in edits.items()}


def _old_coo(matrix: Any) -> Any:
    """With the fields of the SciPy of 2015."""
    made = sp.coo_matrix(matrix)
    made.__dict__.update(row=made.row, col=made.col)
    made.__dict__.pop("coords")
    return made


def _chumpy(fields: Fields, protocol: int = 2, of: str = "scipy.sparse.csc") -> bytes:
    dirs = np.concatenate([fields["shapedirs"], 9 + fields["shapedirs"]], axis=2)
    chosen = sliced(Ch(dirs), dirs.shape, fields["shapedirs"].shape[2])
    sparse = sp.csc_matrix(fields["J_regressor"])
    odd = {"pose_training_info": {"gamma": 5, "names": ["a"], "none": None}, "bs_style": "lbs"}
    changed = {"shapedirs": chosen, "v_template": Ch(fields["v_template"]), "J_regressor": sparse}
    return python2_pickle(fields | odd | changed, protocol, of)


def _sparse(kind: str, protocol: int = 4) -> Callable[[Fields], bytes]:
    made = _with(J_regressor=getattr(sp, kind))
    return lambda fields: pickle.dumps(made(fields), protocol)


def _objects(fields: Fields) -> Fields:
    return fields | {"kintree_table": fields["kintree_table"].astype(object)}


LOADS: dict[str, tuple[str, dict[str, Any], Callable[[Fields], bytes]]] = {
    "chumpy, Python 2": ("basicModel_f_lbs_10_207_0_v1.0.0.pkl", {}, _chumpy),
    "chumpy, 300 shapes": ("basicmodel_f_v1.1.0.pkl", {"shapes": 300}, _chumpy),
    "chumpy, protocol 0": ("basicModel_f_v1.0.0.pkl", {}, lambda f: _chumpy(f, 0)),
    "chumpy, newer SciPy": ("basicmodel_f_v1.1.0.pkl", {}, lambda f: _chumpy(
        f, 2, "scipy.sparse._csc")),
    "npz of a pickle": ("SMPL_FEMALE.npz", {}, lambda f: npz(_with(J_regressor=sp.csc_matrix)(f))),
    "one shape": ("SMPL_FEMALE.npz", {"shapes": 1}, npz),
    "protocol 0": ("SMPL_FEMALE.pkl", {}, lambda f: python2_pickle(f, 0)),
    "protocol 5": ("SMPL_FEMALE.pkl", {}, lambda f: pickle.dumps(f, 5)),
    "protocol 5, turned": (
        "SMPL_FEMALE.pkl", {}, lambda f: pickle.dumps(_with(posedirs=np.asfortranarray)(f), 5)),
    "csc": ("female/model.pkl", {}, _sparse("csc_matrix")),
    "csr": ("female/model.pkl", {}, _sparse("csr_matrix", 2)),
    "csr array": ("female/model.pkl", {}, _sparse("csr_array")),
    "coo": ("female/model.pkl", {}, _sparse("coo_matrix")),
    "coo array": ("female/model.pkl", {}, _sparse("coo_array", 5)),
    "old coo": ("female/model.pkl", {}, lambda f: python2_pickle(
        _with(J_regressor=_old_coo)(f), 2)),
    "float32, root -1": ("SMPL_FEMALE.npz", {"dtype": np.float32, "root": -1}, npz),
    "root 0": ("SMPL_FEMALE.npz", {"root": 0}, npz),
    "big-endian": ("SMPL_FEMALE.npz", {"dtype": ">f4"}, npz),
    "objects": ("SMPL_FEMALE.npz", {}, lambda f: npz(_objects(f))),
    "objects, pkl": ("SMPL_FEMALE.pkl", {}, lambda f: pickle.dumps(_objects(f), 4)),
    "turned over": ("SMPL_FEMALE.npz", {}, lambda f: npz(_with(
        posedirs=_over, shapedirs=_over, weights=np.transpose, J_regressor=np.transpose)(f))),
    "shapes first": ("SMPL_FEMALE.npz", {}, lambda f: npz(_with(
        shapedirs=lambda a: np.moveaxis(a, 2, 0), posedirs=lambda a: np.moveaxis(a, 2, 0))(f))),
    "flat": ("SMPL_FEMALE.npz", {}, lambda f: npz(_with(posedirs=np.ravel, shapedirs=np.ravel)(f))),
    "batches of one": ("SMPL_FEMALE.npz", {}, lambda f: npz(_with(
        v_template=lambda a: a[None], weights=lambda a: a[None])(f))),
    "dictionary in npy": ("SMPL_FEMALE.npy", {}, lambda f: npy(np.array(f, object))),
    "dictionary in npz": ("SMPL_FEMALE.npz", {}, lambda f: npz({"arr_0": np.array(f, object)})),
    "npz named pkl": ("SMPL_FEMALE.pkl", {}, npz),
    "pickle named npz": ("SMPL_FEMALE.npz", {}, lambda f: pickle.dumps(f, 4)),
    "no name's ending": ("female/model", {}, npz),
    "buffers": ("smpl_female.safetensors", {}, lambda f: safetensors(as_buffers(f))),
    "parents alone": ("SMPL_FEMALE.npz", {}, lambda f: npz(_with(kintree_table=lambda k: k[0])(f))),
    "SMPL-H": ("smplh/female/model.npz", {"kind": "smplh", "shapes": 16}, npz),
    "SMPL-H, pkl": ("SMPLH_female.pkl", {"kind": "smplh"}, _chumpy),
    "SMPL-X, 10 + 10": ("SMPLX_FEMALE.npz", {"kind": "smplx", "expressions": 10}, npz),
    "SMPL-X, 300 + 100": (
        "SMPLX_FEMALE.npz", {"kind": "smplx", "shapes": 300, "expressions": 100}, npz),
    "SMPL-X, pkl": (
        "SMPLX_FEMALE.pkl", {"kind": "smplx", "expressions": 10}, lambda f: python2_pickle(f, 2)),
    "SMPL-X, turned over": ("SMPLX_FEMALE.npz", {"kind": "smplx", "expressions": 10},
                            lambda f: npz(_with(posedirs=_over)(f))),
    "SMPL-X without hands": ("SMPLX_FEMALE.npz", {"kind": "smplx", "expressions": 10},
        lambda f: npz({name: f[name] for name in f if "hands" not in name} | _RAGGED)),
    "SMPL-X, apart": ("SMPLX_FEMALE.npz", {"kind": "smplx", "shapes": 12, "expressions": 3},
        lambda f: npz(f | {"shapedirs": f["shapedirs"][..., :12],
                           "expr_dirs": f["shapedirs"][..., 12:]})),
    "SMPL-X, apart, another name": (
        "SMPLX_FEMALE.npz", {"kind": "smplx", "shapes": 20, "expressions": 3},
        lambda f: npz(f | {"shapedirs": f["shapedirs"][..., :20], "expression": np.zeros((1, 10)),
                           "expression_dirs": f["shapedirs"][..., 20:]})),
    "SMPL-X, apart, pkl": (
        "SMPLX_FEMALE.pkl", {"kind": "smplx", "shapes": 16, "expressions": 10},
        lambda f: pickle.dumps(f | {"shapedirs": f["shapedirs"][..., :16],
                                    "Exprs": f["shapedirs"][..., 16:]}, 4)),
    "SMPL-X, expressions twice": (
        "SMPLX_FEMALE.npz", {"kind": "smplx", "shapes": 16, "expressions": 10},
        lambda f: npz(f | {"exprdirs": f["shapedirs"][..., 16:]})),
}  # fmt: skip
"""By variety: the file's name, what `person` and `fields_of` make it of, and how it is written."""


def forged(variety: str) -> tuple[str, bytes, BodyModelData]:
    """Name and bytes of a file, and the body in it."""
    name, options, write = LOADS[variety]
    written = {key: options[key] for key in ("dtype", "root") if key in options}
    body = person(**{key: value for key, value in options.items() if key not in written})
    return name, write(fields_of(body, **written)), body


def rig(joints: int, **changes: Any) -> Fields:
    """Another model's fields under SMPL's names: a chain of joints, a strip of triangles."""
    count = 3 * joints
    near = np.zeros((count, joints))
    near[np.arange(count), np.arange(count) % joints] = 1
    corners = np.arange(count - 2)
    return {
        "v_template": np.linspace(0, 1, 3 * count).reshape(count, 3),
        "f": np.stack([corners, corners + 1, corners + 2], axis=1).astype(np.uint32),
        "weights": near,
        "shapedirs": np.zeros((count, 3, 10)),
        "posedirs": np.zeros((count, 3, 9 * (joints - 1))),
        "J_regressor": near.T / 3,
        "kintree_table": np.stack([np.arange(-1, joints - 1), np.arange(joints)]),
        **changes,
    }


_BODY = fields_of(person())
_WHOLE = npz(_BODY), pickle.dumps(_BODY, 4), pickle.dumps(_BODY, 2)
_PAGE = b"\n<!DOCTYPE html>\n<html><body>Sign in</body></html>\n"
_POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:ab\nsize 39001280\n"
_HANDS = {"hands_componentsl": np.eye(45), "componentsl": np.eye(45), "coeffsl": np.eye(45)}


def _chained(fields: Fields) -> Fields:
    chain = np.stack([np.arange(-1, 23), np.arange(24)])
    return fields | {"kintree_table": chain}


REFUSED: dict[str, tuple[str, bytes, str]] = {
    "FLAME": ("generic_model.pkl", pickle.dumps(rig(5), 2), "FLAME's, a head"),
    "MANO": ("MANO_RIGHT.pkl", pickle.dumps(rig(16, **_HANDS), 2), "MANO's, a hand"),
    "STAR": ("model.npz", npz(_BODY | {"posedirs": np.zeros((162, 3, 93))}), "STAR's"),
    "SUPR": ("supr.npy", npy(np.array(rig(75), object)), "SUPR's"),
    "SMAL": ("smal.pkl", pickle.dumps(rig(33), 2), "SMAL's, an animal"),
    "SKEL": ("skel.pkl", pickle.dumps({"skin_template_v": 1.0}, 4), "SKEL's"),
    "another skeleton": ("SMPL.npz", npz(_chained(_BODY)), "joint 2 has parent 1: another skel"),
    "of 127 joints": ("body.npz", npz(rig(127)), "a skeleton of 127 joints"),
    "DMPL": ("model.npz", npz({"eigvec": np.zeros((9, 3, 10))}), "DMPL's.*--dmpl"),
    "motion": ("walk.npz", npz({"poses": np.zeros((9, 156)), "betas": np.zeros(16)}), "--motion"),
    "motions by person": ("wham.pkl", pickle.dumps({0: {"pose": 1.0}}, 4), "--motion"),
    "fits": ("SMPL_NEUTRAL.pkl", pickle.dumps([{"pose": 1.0}], 2), "list of 1.*--motion"),
    "hand prior": ("pose_hand_prior.npz", npz(_HANDS), "hands"),
    "template": ("smpl_kid_template.npy", npy(_BODY["v_template"]), "vertices alone"),
    "SMPL++": ("smpl.npz", npz({"vertices_template": _BODY["v_template"]}), r"SMPL\+\+'s"),
    "nothing of it": ("a.npz", npz({"x": np.zeros(3)}), r"no field 'v_template' \(it has x\)"),
    "scene": ("SMPL_female.fbx", b"Kaydara FBX Binary  \0\x1a\0" + bytes(99), r"a scene \(.fbx\)"),
    "web page": ("SMPL_NEUTRAL.pkl", _PAGE, "a web page.*Sign in"),
    "web page, npz": ("SMPL_NEUTRAL.npz", b"\xef\xbb\xbf" + _PAGE, "a web page.*Sign in"),
    "text": ("SMPLX_NEUTRAL.npz", b"Error: File not found.\n", "'Error: File not found.'"),
    "git-lfs": ("SMPL_NEUTRAL.pkl", _POINTER, "git lfs pull"),
    "git-lfs, npz": ("SMPL_NEUTRAL.npz", _POINTER, "git lfs pull"),
    "git-annex": ("SMPL.npz", b"/annex/objects/SHA256E-s1--ab.npz\n", "git annex get"),
    "zip": ("SMPL.zip", zipped({"__MACOSX/._a.pkl": b"", "smpl/models/a.pkl": b"x"}),
            "Unpack it, and pass smpl/models/a.pkl"),
    "zip named npz": ("smplx.npz", zipped({"smplx/A.npz": b"x"}), "pass smplx/A.npz"),
    "zip of others": ("docs.zip", zipped({"read.me": b"x"}), "without a body model"),
    "tar.xz": ("smplh.tar.xz", b"\xfd7zXZ\0" + bytes(60), "not unpacked.*Unpack it"),
    "tar": ("smplh.tar", b"model.npz".ljust(257, b"\0") + b"ustar" + bytes(60), "not unpacked"),
    "half an npz": ("SMPL.npz", _WHOLE[0][: len(_WHOLE[0]) // 2], "cut short.*again"),
    "half a pkl": ("SMPL.pkl", _WHOLE[1][: len(_WHOLE[1]) // 2], "cut short.*again"),
    "half an old pkl": ("SMPL.pkl", _WHOLE[2][: len(_WHOLE[2]) // 2], "cut short.*again"),
    "nine tenths of a pkl": ("SMPL.pkl", _WHOLE[1][:-99], "cut short.*again"),
    "zeros": ("SMPL.pkl", bytes(4096), "zeros"),
    "nothing": ("SMPL.pkl", b"", "an empty file"),
    "noise": ("SMPL.pkl", b"\xff\xd8\xff\xe0JFIF", "of no kind that is read"),
    "centimetres": ("SMPL.npz", npz(_with(v_template=lambda v: 100 * v)(_BODY)), "in centimetres"),
    "no faces": ("SMPL.npz", npz({n: v for n, v in _BODY.items() if n != "f"}), "no field 'f'"),
    "faces from 1": ("SMPL.npz", npz(_with(f=lambda f: f + 1)(_BODY)), "faces index vertices"),
    "17 rows": ("SMPL.npz", npz(_with(J_regressor=lambda j: j[:17])(_BODY)), "J_regressor has"),
    "half a skin": ("SMPL.npz", npz(_with(f=lambda f: f[::2])(_BODY)), "leave holes"),
    "inside out": ("SMPL.npz", npz(_with(f=lambda f: f[:, ::-1])(_BODY)), "wind clockwise"),
}  # fmt: skip
"""By what it is: the file's name, its bytes, and what a refusal says."""
