"""`dsnet_plus` as a PyTorch layer: poses and shapes to offsets of the skin, with gradients.

    layer = dsnet.soft_tissue(body="SMPL_FEMALE.pkl")
    offsets_m, state = layer(theta, betas)    # (B, T, 69), (B, 10) -> (B, T, V, 3) metres

The same equations as the step that predictions repeat (`dsnet.onnx.plus_graph`), but over time
too: kinematics and loads of many frames together, and a loop over frames of the nodes alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.utils.checkpoint import checkpoint

from bridge.body import BodyModelData
from bridge.errors import DsnetError
from bridge.paper import FPS, N_BETAS, THETA_SIZE
from bridge.tissue.oscillators import GRAVITY_M_S2
from bridge.tissue.trained_plus import KERNEL_WIDTH, TrainedPlus, people_kernel
from torch_align_ae.body.smpl import register_constants
from torch_align_ae.tissue.kinematics import (
    POSE_FEATURES,
    Kinematics,
    NodesToSkin,
    joint_rotations,
    pose_features,
)
from torch_align_ae.tissue.shape import NodeShapes
from torch_align_ae.tissue.springs import Springs, make_springs, settled, simulate, smoothed

PIECE = 64
"""Frames that are computed together. For gradients only the state between pieces is remembered."""


class TissueState(NamedTuple):
    """The tissue of B people after some frames: all that the next ones need."""

    theta: Tensor
    """(B, H, 69) the newest poses."""
    loads: Tensor
    """(B, N - 1, 3, K) the newest loads, m/s^2."""
    now: Tensor
    """(B, 3, K) offsets of the nodes in the newest frame that is certain, metres."""
    before: Tensor
    """(B, 3, K) the same, half a frame earlier."""
    frames: int
    """How many have been passed."""
    given: int
    """Of how many the offsets have been returned."""

    def detach(self) -> TissueState:
        """The same, without its history: for truncated backpropagation through time."""
        return self._make(v.detach() if isinstance(v, Tensor) else v for v in self)


class SoftTissue(nn.Module):
    """A trained `dsnet_plus` on a body of V vertices and S shapes.

    Parameters of the module are what training learns: logarithms of the nodes' coefficients, how
    these follow a person's shape, the weights of past loads, and what follows the pose alone.

    Parameters
    ----------
    trained : see `TrainedPlus`; `dsnet.soft_tissue` takes the package's, a run's or a folder's.
    body : what it moves: the body that it was trained on, or that it was carried over to.
    dtype : float32 or float64.
    """

    _laplacian: Tensor
    _twice_laplacian: Tensor
    _gravity: Tensor

    def __init__(
        self, trained: TrainedPlus, body: BodyModelData, dtype: torch.dtype = torch.float32
    ) -> None:
        super().__init__()
        self.look_ahead, self._kept = trained.look_ahead, max(2, trained.look_ahead)
        nodes, weights, elsewhere = trained.nodes, trained.weights, trained.elsewhere

        def parameter(array: NDArray) -> nn.Parameter:
            return nn.Parameter(torch.from_numpy(np.array(array)).to(dtype))

        logs = {name: parameter(log[:, 0]) for name, log in weights.base.items()}
        self.log_coefficients = nn.ParameterDict(logs)
        self.slopes = parameter(weights.slopes[:, 0])
        self.stiffening_power = parameter(weights.stiffening_power)
        self.residual = parameter(weights.residual[..., 0])
        self.taps = parameter(weights.taps)
        self.by_pose_m = parameter(trained.static.by_pose_m[:POSE_FEATURES].transpose(0, 2, 1))
        self._shapes = NodeShapes(
            body, nodes.vertices, None if elsewhere is None else elsewhere.template, dtype
        )
        self._kinematics = Kinematics(body, nodes.vertices, dtype)
        self._to_skin = NodesToSkin(nodes, dtype)
        self._people = _People(trained, dtype)
        laplacian = nodes.laplacian.toarray().astype(np.float64)
        buffers = {
            "_laplacian": laplacian,
            "_twice_laplacian": laplacian @ laplacian,
            "_gravity": GRAVITY_M_S2[:, None],
        }
        register_constants(self, buffers, dtype)

    @property
    def v_template(self) -> Tensor:
        """(V, 3) of the body, metres: in this order vertices are."""
        return self._shapes.template

    def forward(
        self,
        theta: Tensor,
        betas: Tensor,
        state: TissueState | None = None,
        more: bool = False,
    ) -> tuple[Tensor, TissueState]:
        """Offsets (B, T, V, 3) in the rest pose, metres, and the state after the motion.

        Parameters
        ----------
        theta : (B, T, 69) pose and translation at 60 frames a second, y up, as everywhere here:
            axis-angle of 22 joints, radians, then metres.
        betas : (B, S) shapes.
        state : of an earlier call, whose motion goes on; None: from rest, settled in the first
            pose.
        more : the motion goes on in another call. Loads are smoothed over `look_ahead` later
            frames, so the last of these are returned by the next call; joined, the results are
            exactly those of one call. Otherwise they are as if the motion ended here.

        Raises
        ------
        DsnetError
            If shapes do not fit.
        """
        at_nodes, after = self.at_nodes(theta, betas, state, more)
        return self.on_skin(at_nodes, betas), after

    def at_nodes(
        self,
        theta: Tensor,
        betas: Tensor,
        state: TissueState | None = None,
        more: bool = False,
    ) -> tuple[Tensor, TissueState]:
        """Offsets (B, T, 3, K) of the nodes, metres: `forward` without the skin between them."""
        self._check(theta, betas, state)
        springs, pieces = self._springs(betas), theta.split(PIECE, 1)
        after, offsets = state or self._begin(theta, betas, springs), []
        for number, piece in enumerate(pieces):
            ends = number == len(pieces) - 1 and not more
            arguments = (piece, betas, springs, after, ends)
            if torch.is_grad_enabled() and len(pieces) > 1:
                some, after = checkpoint(self._piece, *arguments, use_reentrant=False)
            else:
                some, after = self._piece(*arguments)
            offsets.append(some)
        return torch.cat(offsets, 1), after

    def on_skin(self, at_nodes: Tensor, betas: Tensor) -> Tensor:
        """Offsets (B, T, V, 3) of the skin from those (B, T, 3, K) of the nodes."""
        constant_m = self._people.constant_m(betas)
        skin = self._to_skin(at_nodes)
        return skin if constant_m is None else skin + constant_m[:, None]

    def in_world(self, offsets_m: Tensor, theta: Tensor) -> Tensor:
        """How far offsets (B, T, V, 3) move the posed skin, metres in the world: skinning is
        linear, so posed vertices of any SMPL implementation, plus this, are those with tissue."""
        return self._kinematics.turned(joint_rotations(theta), offsets_m)

    def _check(self, theta: Tensor, betas: Tensor, state: TissueState | None) -> None:
        shapes = len(self._shapes.shapedirs)
        people = len(betas)
        fits = theta.ndim == 3 and theta.shape[2] == THETA_SIZE and theta.shape[1] > 0
        if not fits or len(theta) != people or tuple(betas.shape) != (people, shapes):
            raise DsnetError(
                f"theta {tuple(theta.shape)} and betas {tuple(betas.shape)}",
                f"(B, T, {THETA_SIZE}) and (B, {shapes})",
                "Give one motion of one or more frames, and one shape, for each person.",
            )
        if state is not None and len(state.now) != people:
            raise DsnetError(
                f"a state of {len(state.now)} people for {people}",
                "the same people as before",
                "Pass state=None where a motion begins.",
            )

    def _springs(self, betas: Tensor) -> Springs:
        """The tissue of people (B, S)."""
        features, normals = self._shapes(betas)
        deviation = features @ self.slopes + self._people.shares(betas) @ self.residual
        return make_springs(
            dict(self.log_coefficients.items()),
            deviation[:, None],
            self.stiffening_power,
            normals.transpose(1, 2),
            (self._laplacian, self._twice_laplacian),
        )

    def _begin(self, theta: Tensor, betas: Tensor, springs: Springs) -> TissueState:
        """People who have stood in the first of their poses for ever.

        Found before any piece: a piece is computed twice for its gradient, and the equilibrium's
        own gradient takes many sweeps.
        """
        first = theta[:, :1]
        _, load = self._loads(first, joint_rotations(first), betas, 0)
        rest = settled(springs, load[:, 0])
        loads = load.expand(-1, len(self.taps) - 1, -1, -1)
        return TissueState(theta[:, :0], loads, rest, rest, 0, 0)

    def _piece(
        self, theta: Tensor, betas: Tensor, springs: Springs, state: TissueState, ends: bool
    ) -> tuple[Tensor, TissueState]:
        """Offsets (B, T', 3, K) of the frames that a piece of a motion makes certain, or of all
        that remain if it ends there, and the state after the piece."""
        frames, given, now, before = state.frames, state.given, state.now, state.before
        poses = torch.cat([state.theta, theta], 1)
        rotations = joint_rotations(poses)
        loads, last = self._loads(poses, rotations, betas, frames)
        loads = torch.cat([state.loads, loads], 1)
        offsets = [] if frames else [now]
        certain, frames = _certain(frames, self.look_ahead), frames + theta.shape[1]
        moved, now, before = self._moved(springs, loads, now, before, _known(frames))
        offsets += moved
        newest = loads[:, loads.shape[1] - len(self.taps) + 1 :]
        kept = poses[:, -self._kept :]
        after = TissueState(kept, newest, now, before, frames, certain + len(offsets))
        if ends and frames > 1:
            loads = torch.cat([newest, last.expand(-1, self.look_ahead, -1, -1)], 1)
            rest, *_ = self._moved(springs, loads, now, before, _known(frames) + self.look_ahead)
            offsets += rest
            after = after._replace(given=frames)
        new = offsets[given - certain :]
        if not new:
            return now.new_empty((len(now), 0, *now.shape[1:])), after
        features = pose_features(rotations[:, given - frames :][:, : len(new)])
        return torch.stack(new, 1) + torch.tensordot(features, self.by_pose_m, 1), after

    def _loads(
        self, poses: Tensor, rotations: Tensor, betas: Tensor, frames: int
    ) -> tuple[Tensor, Tensor]:
        """Loads (B, M, 3, K), m/s^2, that become known with the poses after the first `frames`, and
        that of the last frame (B, 1, 3, K) if the motion ends there.

        Acceleration is a central difference; the first and the last frame have none. Places are
        relative to the root, whose translation is differenced for itself: far from the origin
        their sum would lose the digits that accelerations need.
        """
        new = poses.shape[1] - min(frames, self._kept)
        window = new + min(frames, 2)
        places, turns = self._kinematics(rotations[:, -window:], betas)
        moves = places.diff(dim=1) + poses[:, -window:, -3:].diff(dim=1)[..., None]
        acceleration = FPS**2 * moves.diff(dim=1)
        if frames:
            turned = turns[:, 1 : 1 + acceleration.shape[1]]
        else:
            acceleration = torch.cat([torch.zeros_like(places[:, :1]), acceleration], 1)
            turned = turns[:, : acceleration.shape[1]]
        logs = self.log_coefficients
        inertia_gain, gravity_gain = (torch.exp(logs[f"{n}_gain"]) for n in ("inertia", "gravity"))
        # R^T w, of which component y is column y of R times w.
        inertia = (turned * acceleration[:, :, :, None]).sum(2)
        down = (turns * self._gravity[:, None]).sum(2) - self._gravity
        weight = gravity_gain * down
        first = min(frames, 1)
        known = weight[:, first : first + inertia.shape[1]] - inertia_gain * inertia
        return known, weight[:, -1:]

    def _moved(
        self, springs: Springs, loads: Tensor, now: Tensor, before: Tensor, known: int
    ) -> tuple[list[Tensor], Tensor, Tensor]:
        """Frames after `now` by loads (B, N - 1 + M, 3, K), of which M are new and the last is that
        of frame `known` - 1; and the newest two steps."""
        new = loads.shape[1] - len(self.taps) + 1
        # Loads of the first frames lie ahead of no frame but those that are settled.
        settled_already = max(self.look_ahead - (known - new), 0)
        return simulate(springs, smoothed(loads, self.taps)[:, settled_already:], now, before)


class _People(nn.Module):
    """Of known people, whose tissue is known beyond what shape explains: who is like them."""

    people: Tensor
    inverse: Tensor
    constants_m: Tensor
    to_betas: Tensor
    shift: Tensor

    def __init__(self, trained: TrainedPlus, dtype: torch.dtype) -> None:
        super().__init__()
        people, elsewhere = trained.people_betas.astype(np.float64), trained.elsewhere
        buffers = {
            "people": people,
            "inverse": np.linalg.inv(people_kernel(people)),
            "constants_m": trained.static.constant_m,
            "to_betas": np.eye(N_BETAS) if elsewhere is None else elsewhere.to_betas,
            "shift": np.zeros(N_BETAS) if elsewhere is None else elsewhere.shift,
        }
        register_constants(self, buffers, dtype)

    def shares(self, betas: Tensor) -> Tensor:
        """(B, P) as `shares_of_people`, of betas (B, S)."""
        apart = self.people - self._trained(betas)[:, None]
        return torch.exp(apart.square().sum(2) / (-2 * KERNEL_WIDTH**2)) @ self.inverse

    def constant_m(self, betas: Tensor) -> Tensor | None:
        """(B, V, 3) of exactly the known people, as `known_person`; None where nobody has one."""
        if not len(self.constants_m):
            return None
        same = torch.isclose(self.people, self._trained(betas)[:, None], atol=1e-5).all(2)
        return torch.tensordot(same.to(betas.dtype), self.constants_m, 1)

    def _trained(self, betas: Tensor) -> Tensor:
        """Betas (B, 10) in the shape space of the body of training."""
        return betas @ self.to_betas + self.shift


def _known(frames: int) -> int:
    """Of how many frames the loads are known when `frames` poses are: the last one's acceleration
    needs the next pose, but the first frame has none."""
    return max(frames - 1, min(frames, 1))


def _certain(frames: int, look_ahead: int) -> int:
    """Of how many frames the offsets are known when `frames` poses are."""
    return 1 + max(_known(frames) - look_ahead, 0) if frames else 0
