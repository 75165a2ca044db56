"""The oscillators of `dsnet_plus` in PyTorch; `bridge.tissue.oscillators` has the equations.

Nodes are the last axis, (B, 3, K), so that coupling them is one matrix product for all B people.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import torch
from torch import Tensor

from bridge.paper import FPS
from bridge.tissue.oscillators import STEPS, SWEEPS
from bridge.tissue.trained_plus import SAG_POWER

_STEP_S = 1 / (STEPS * FPS)
_MOST_SWEEPS = 2000
"""Of the equilibrium and of its gradient; trained models need about sixty in float32."""


class Springs(NamedTuple):
    """Coefficients of K nodes of B people, (B, 1, K) unless stated."""

    spring: Tensor  # dt^2 / 4 times w^2
    stiffer: Tensor  # dt^2 / 2 times w^2 a, 1/m^2
    standing: Tensor  # dt^2 / 2 times w^2 a |s|_P^2
    drag: Tensor  # Z W dt
    hung: Tensor  # (B, 3, K) 2 s, m
    normals: Tensor  # (B, 3, K)
    beyond: Tensor  # (K,) p - 1
    bound: Tensor  # (K,) N: sums over rows of dt^2 |C| / 4
    pulled: Tensor  # (K, K) the transpose of N - dt^2 C / 4


def make_springs(
    logs: Mapping[str, Tensor],
    deviation: Tensor,
    stiffening_power: Tensor,
    normals: Tensor,
    laplacian: tuple[Tensor, Tensor],
) -> Springs:
    """The tissue of B people.

    Parameters
    ----------
    logs : (K,) logarithms of the template body's coefficients, by name.
    deviation : (B, 1, K) by which log W of each person differs from it.
    stiffening_power : (1,) by which log a follows the deviation.
    normals : (B, 3, K) outward, in the rest pose.
    laplacian : (K, K) of the nodes, and its square.
    """
    omega = torch.exp(logs["omega"] + deviation)
    stiffening = torch.exp(logs["stiffening"] + stiffening_power * deviation)
    sag = torch.exp(logs["sag"] + SAG_POWER * deviation)
    beyond = torch.exp(logs["normal_ratio"]) - 1
    once, twice = laplacian
    coupling = torch.exp(2 * logs["wave_speed"])[:, None] * once
    coupling = coupling + torch.exp(logs["bending"])[:, None] * twice
    between = _STEP_S**2 / 4 * coupling
    hanging = sag.square() * (1 + beyond * normals[:, 1:2].square())
    taut = stiffening * hanging
    spring = _STEP_S**2 / 4 * omega.square() / (1 + 3 * taut)
    down = torch.zeros_like(normals)
    down[:, 1] = -2
    bound = between.abs().sum(1)
    return Springs(
        spring,
        stiffer=2 * spring * stiffening,
        standing=2 * spring * taut,
        drag=_STEP_S * omega * torch.exp(logs["damping_ratio"]),
        hung=down * sag,
        normals=normals,
        beyond=beyond,
        bound=bound,
        pulled=(torch.diag(bound) - between).T.contiguous(),
    )


def smoothed(loads: Tensor, taps: Tensor) -> Tensor:
    """Weighted sums (B, T, 3, K) of loads (B, T + N - 1, 3, K), the newest by the first tap."""
    older = len(taps) - 1
    count = loads.shape[1] - older
    total = torch.zeros_like(loads[:, older:])
    for back, tap in enumerate(taps):
        total = total + tap * loads[:, older - back : older - back + count]
    return total


def simulate(
    springs: Springs, loads: Tensor, now: Tensor, before: Tensor
) -> tuple[list[Tensor], Tensor, Tensor]:
    """Offsets (B, 3, K), metres, of the frames after `now`, then the newest and those a step
    earlier.

    `loads` (B, T, 3, K), m/s^2, act until each of the T frames.
    """
    frames: list[Tensor] = []
    for load in (_STEP_S**2 * loads).unbind(1):
        for _ in range(STEPS):
            before, now = now, _step(springs, load, now, before)
        frames.append(now)
    return frames, now, before


def _step(springs: Springs, load: Tensor, now: Tensor, before: Tensor) -> Tensor:
    """Offsets (B, 3, K) a step after `now`, which followed `before`; the load is times dt^2."""
    gained = springs.stiffer * _strain(springs, now)
    stiffer = springs.standing + gained
    twice, after = 2 * now + before, 2 * now - before
    right = load + after + springs.drag * before
    sheared = springs.spring * twice + stiffer * before + gained * springs.hung
    right = right - _stretched(springs, sheared) + twice @ springs.pulled - springs.bound * twice
    held = springs.spring + stiffer
    along = 1 + springs.drag + springs.bound + held
    beyond = springs.beyond * held
    for _ in range(SWEEPS):
        after = _solved(springs, right + after @ springs.pulled, along, beyond)
    return after


def settled(springs: Springs, load: Tensor) -> Tensor:
    """Offsets (B, 3, K) in equilibrium under a constant load (B, 3, K), m/s^2.

    Sweeps as in a step find the fixed point z = F(z) of offsets and strains together, with the
    strain updated by Newton's method. Its gradient is that of the implicit function,
    dz = (1 - F')^-1 dF: the same sweeps, transposed, solve it, so no sweep is remembered. There is
    no second derivative (NotImplementedError).
    """
    constants = (*springs, load)

    def sweep(z: Tensor, constants: tuple[Tensor, ...]) -> Tensor:
        return _sweep(z, Springs(*constants[:-1]), constants[-1])

    fixed = tuple(one.detach() for one in constants)
    with torch.no_grad():
        z = torch.zeros_like(torch.cat([load, load[:, :1]], 1))
        for _ in range(_MOST_SWEEPS):
            z, last = sweep(z, fixed), z
            if _same(z, last):
                break
    z = sweep(z, constants)
    if z.requires_grad:
        start = z.detach().requires_grad_()
        with torch.enable_grad():
            again = sweep(start, fixed)

        def solved(gradient: Tensor) -> Tensor:
            if torch.is_grad_enabled():  # what follows is not recorded
                raise NotImplementedError("second derivatives of the equilibrium")
            total = gradient
            for _ in range(_MOST_SWEEPS):
                (back,) = torch.autograd.grad(again, start, total, retain_graph=True)
                total, last = gradient + back, total
                if _same(total, last):
                    break
            return total

        z.register_hook(solved)
    return z[:, :3]


def _same(new: Tensor, old: Tensor) -> bool:
    """Whether the last sweep has changed nothing that the dtype resolves."""
    size = new.abs().max()
    return bool((new - old).abs().max() <= 4 * torch.finfo(new.dtype).eps * size)


def _sweep(z: Tensor, springs: Springs, load: Tensor) -> Tensor:
    """Offsets and strains (B, 4, K) a sweep nearer to equilibrium under a load (B, 3, K)."""
    offsets_m, strain = z[:, :3], z[:, 3:]
    gained = springs.stiffer * strain
    spring = springs.spring + (springs.standing + gained) / 2
    left = _STEP_S**2 / 4 * load + offsets_m @ springs.pulled
    left = left - gained * _stretched(springs, springs.hung) / 4
    new_m = _solved(springs, left, springs.bound + spring, springs.beyond * spring)
    reached = _strain(springs, new_m)
    # Of the coupling only what holds a node itself counts for the slope of its strain.
    own = springs.bound - springs.pulled.diagonal()
    slope = (springs.standing + springs.stiffer * reached) / (spring + own)
    return torch.cat([new_m, strain + (reached - strain) / (1 + slope)], 1)


def _strain(springs: Springs, offsets_m: Tensor) -> Tensor:
    """The strain q = |v|_P^2 - |s|_P^2, (B, 1, K)."""
    stretched = _stretched(springs, offsets_m)
    return ((offsets_m + springs.hung) * stretched).sum(1, keepdim=True)


def _stretched(springs: Springs, offsets_m: Tensor) -> Tensor:
    """P u."""
    outward = (offsets_m * springs.normals).sum(1, keepdim=True)
    return offsets_m + springs.beyond * outward * springs.normals


def _solved(springs: Springs, left: Tensor, along: Tensor, beyond: Tensor) -> Tensor:
    """Each node's block, `along` I + `beyond` n n^T, inverted on `left` (Sherman and Morrison)."""
    outward = (left * springs.normals).sum(1, keepdim=True) * (beyond / (along + beyond))
    return (left - outward * springs.normals) / along
