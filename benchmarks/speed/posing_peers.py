"""Ours and others' ways from a pose to posed vertices, on one body model and on the same bodies."""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import io
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from torch import Tensor

from benchmarks.speed.limits import GraphCall
from bridge.body import BodyModelData
from bridge.motion import unpack_theta
from bridge.paper import N_BETAS, THETA_SIZE
from torch_align_ae.body import SMPL

Call = Callable[[], Any]
"""Gives vertices (B, V, 3), metres."""
OURS = "onnx"
PEERS = ("smplx", "smplfitter")


@dataclass(frozen=True, eq=False)
class DrawnBodies:
    """B bodies in random poses, as every contender wants them."""

    theta: NDArray[np.float32]
    """(B, 69)."""
    betas: NDArray[np.float32]
    """(B, 10)."""

    @classmethod
    def drawn(cls, rng: np.random.Generator, count: int) -> DrawnBodies:
        """Turn every joint by some tenths of a radian."""
        theta, betas = rng.normal(0, 0.3, (count, THETA_SIZE)), rng.normal(size=(count, N_BETAS))
        return cls(theta.astype(np.float32), betas.astype(np.float32))

    def as_smpl(self) -> dict[str, NDArray[np.float32]]:
        """`betas` (B, 10), `pose` (B, 72) with hands at rest, and `trans` (B, 3)."""
        joints, trans = unpack_theta(self.theta)
        pose = np.pad(joints, ((0, 0), (0, 2), (0, 0))).reshape(len(joints), -1)
        return {"betas": self.betas, "pose": pose, "trans": np.ascontiguousarray(trans)}

    def as_tensors(self) -> dict[str, Tensor]:
        """The same as tensors."""
        return {name: torch.from_numpy(array) for name, array in self.as_smpl().items()}


Poser = Callable[[DrawnBodies], Call]


def posers(body: BodyModelData, model: onnx.ModelProto, threads: int) -> dict[str, Poser]:
    """Every contender that is installed, the graph `model` first, each as maker of calls."""
    module = SMPL(body)

    def by_module(bodies: DrawnBodies) -> Call:
        given = bodies.as_tensors()
        pose = given["pose"].unflatten(1, (-1, 3))
        return lambda: module(given["betas"], pose, given["trans"])

    found: dict[str, Poser] = {OURS: _by_graph(model, threads), "torch": by_module}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"basicmodel_{body.gender[0]}_lbs_10_207_0_v1.1.0.pkl"
        body.save_smpl_pkl(path)
        np.save(Path(folder) / "kid_template.npy", body.v_template)
        for peer, make in (("smplx", _smplx), ("smplfitter", _smplfitter)):
            if importlib.util.find_spec(peer) is not None:
                found |= make(path, body.gender, threads)
    return found


def _by_graph(model: onnx.ModelProto, threads: int) -> Poser:
    def poser(bodies: DrawnBodies) -> Call:
        call = GraphCall(model, np.random.default_rng(0), len(bodies.theta), threads)
        call.feed = {"theta": bodies.theta, "betas": bodies.betas}
        return lambda: call()["found"]

    return poser


def _smplx(path: Path, gender: str, threads: int) -> dict[str, Poser]:
    with contextlib.redirect_stdout(io.StringIO()):  # it prints how many shapes there are
        model = importlib.import_module("smplx").SMPL(str(path), gender=gender)

    def poser(bodies: DrawnBodies) -> Call:
        given = bodies.as_tensors()
        named = {
            "betas": given["betas"],
            "global_orient": given["pose"][:, :3].contiguous(),
            "body_pose": given["pose"][:, 3:].contiguous(),
            "transl": given["trans"],
        }
        return lambda: model(**named).vertices

    return {"smplx": poser}


def _smplfitter(path: Path, gender: str, threads: int) -> dict[str, Poser]:
    """In PyTorch, as it is and as TorchScript; and in Numba where that is installed."""
    options = {"model_root": str(path.parent), "num_betas": N_BETAS}
    model = importlib.import_module("smplfitter.pt").BodyModel("smpl", gender, **options)
    found = {
        "smplfitter_torch": _fitter_poser(model, DrawnBodies.as_tensors),
        "smplfitter_torchscript": _fitter_poser(torch.jit.script(model), DrawnBodies.as_tensors),
    }
    if importlib.util.find_spec("numba") is not None:
        importlib.import_module("numba").set_num_threads(threads)
        compiled = importlib.import_module("smplfitter.nb").BodyModel("smpl", gender, **options)
        found["smplfitter_numba"] = _fitter_poser(compiled, DrawnBodies.as_smpl)
    return found


def _fitter_poser(model: Any, given: Callable[[DrawnBodies], dict[str, Any]]) -> Poser:
    def poser(bodies: DrawnBodies) -> Call:
        arrays = given(bodies)
        named = {
            "pose_rotvecs": arrays["pose"],
            "shape_betas": arrays["betas"],
            "trans": arrays["trans"],
        }
        return lambda: model(**named)["vertices"]

    return poser
