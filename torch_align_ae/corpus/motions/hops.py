"""Vertical motion of hops: a countermovement, then ballistic flights and contacts in turn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from torch_align_ae.corpus.motions.curves import track
from torch_align_ae.corpus.motions.plan import GRAVITY_M_S2, Array
from torch_align_ae.corpus.motions.postures import Contact, Swing

_CROUCH_S = 0.36
_CROUCH_ACCELERATION_M_S2 = 5.0


@dataclass(frozen=True)
class HopTimes:
    """Durations that make one kind of hop."""

    begin_s: float
    """When the countermovement begins; until then the body is still."""
    flight_s: float
    """Mean flight."""
    contact_s: float
    """Mean contact between two flights."""
    take_off_m: float
    """Height of the pelvis above standing when the feet leave and meet the floor."""
    crouch_m: float
    """Depth of the countermovement below standing."""
    spread_sink_m: float = 0.0
    """How much lower the pelvis is in every second contact, when the legs stand apart."""
    variation: float = 0.06
    """Relative standard deviation of each duration."""


@dataclass(frozen=True, eq=False)
class Hops:
    """Take-offs, landings, and the pelvis's height above standing."""

    take_offs_s: Array
    landings_s: Array
    height_m: Array
    """(T,) over the times asked for."""

    def contacts(self, x_m: Array | float = 0.0, z_m: float = 0.0) -> list[Contact]:
        """Contacts of a foot that takes part in every hop; `x_m` may hold one place a contact."""
        starts = np.concatenate([[-1.0], self.landings_s])
        stops = np.concatenate([self.take_offs_s, [np.inf]])
        places = np.broadcast_to(x_m, starts.shape)
        return [Contact(*row, z_m) for row in zip(starts, stops, places, strict=True)]

    def swings(self, tuck_m: float, **angles: float) -> list[Swing]:
        """Swings that keep below the body: as high as the flight, and `tuck_m` drawn up."""
        flights_s = self.landings_s - self.take_offs_s
        rises_m = GRAVITY_M_S2 * flights_s**2 / 8
        return [Swing(float(rise_m) + tuck_m, **angles) for rise_m in rises_m]


def plan_hops(times_s: Array, hop: HopTimes, rng: np.random.Generator) -> Hops:
    """Hop from `hop.begin_s` until after the last of `times_s`."""
    end_s = times_s[-1] + 0.01
    flights_s, contacts_s = _durations(hop, end_s - hop.begin_s, rng)
    sinks_m = hop.spread_sink_m * (np.arange(len(flights_s) + 1) % 2)
    heights_m = hop.take_off_m - sinks_m
    speeds = GRAVITY_M_S2 * flights_s / 2 + np.diff(heights_m) / flights_s
    crouch_s = hop.begin_s + _CROUCH_S
    push_s = _push_s(hop.crouch_m + hop.take_off_m, speeds[0])
    knots = [
        (hop.begin_s, 0.0, 0.0, 0.0),
        (crouch_s, -hop.crouch_m, 0.0, _CROUCH_ACCELERATION_M_S2),
    ]
    take_offs_s, landings_s = [], []
    now_s = crouch_s + push_s
    for hop_index, (flight_s, contact_s) in enumerate(zip(flights_s, contacts_s, strict=True)):
        take_offs_s.append(now_s)
        landings_s.append(now_s + flight_s)
        rising, falling = speeds[hop_index], speeds[hop_index] - GRAVITY_M_S2 * flight_s
        knots += [
            (now_s, heights_m[hop_index], rising, -GRAVITY_M_S2),
            (now_s + flight_s, heights_m[hop_index + 1], falling, -GRAVITY_M_S2),
        ]
        now_s += flight_s + contact_s
    return Hops(np.array(take_offs_s), np.array(landings_s), track(times_s, knots))


def _push_s(rise_m: float, speed_m_s: float) -> float:
    """Duration of the push from the crouch whose velocity is a cubic, so that none overshoots.

    Such a push rises by T v / 2 + T^2 (a0 - a1) / 12, with accelerations a0 and a1 at its ends.
    """
    curvature = (_CROUCH_ACCELERATION_M_S2 + GRAVITY_M_S2) / 12
    half = speed_m_s / 4
    return float((np.sqrt(half**2 + curvature * rise_m) - half) / curvature)


def _durations(hop: HopTimes, span_s: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Flights and contacts that more than fill `span_s`; the same whatever the frame rate."""
    count = int(np.ceil(span_s / (0.7 * (hop.flight_s + hop.contact_s)))) + 1
    factors = 1 + hop.variation * np.clip(rng.standard_normal((count, 2)), -2, 2)
    return hop.flight_s * factors[:, 0], hop.contact_s * factors[:, 1]
