"""The robots as one kitchen scale: each measures its share of the weight, and the shares add up to the mass.

A robot at rest knows from its accelerometer which way is up, so it needs no other robot's pose to know its share
``m_i = (f_i · a_i) / |a_i|²`` with the force ``f_i`` on the payload and the proper acceleration ``a_i``. The mass is
the sum of all shares. Centre of mass and inertia stay unknown, and so does the mass while the payload is shaken or
turned.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Mapping

import msgspec
import numpy as np

from coheft.agents.estimator import Belief, Channels
from coheft.consensus.gossip import Gossip
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import ACCELERATION, FORCE, GYRO, MeasurementBlock
from coheft.wire.config import AgentConfig
from coheft.wire.messages.structs import PayloadEstimate

_GRAVITY = 9.81
_LEAST = 0.5
"""How long the payload has to rest before its mass is published [s]."""
_JUMP = 5.0
"""Standard deviations."""
_NOT_MEASURED = "a scale does not measure it"


class ScaleSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The settings in ``[settings.scale]`` of a scenario.

    Attributes:
        window: Time over which a share is averaged [s].
        turning: The payload rests while it turns no faster than that [rad/s],
        shaking: and while accelerometers read gravity up to that [m/s²].
    """

    window: float = 2.0
    turning: float = 0.05
    shaking: float = 0.3


class Scale:
    """One robot's share of the scale. See ``coheft.agents.estimator.Estimator``."""

    def __init__(self, config: AgentConfig, gossip: Gossip) -> None:
        self._config = config
        self._gossip = gossip  # knows who holds the payload
        self._settings = msgspec.convert(config.estimator_settings, ScaleSettings)
        self._shares: dict[str, Array] = {}
        """The newest share received of each robot: block, share [kg]."""
        self._sums: deque[float] = deque(maxlen=max(2, config.blocks(self._settings.window)))
        """Sums of all shares, one per block since the payload rests [kg]."""
        self._index = -1

    def step(self, index: int, own: MeasurementBlock | None, inbox: Mapping[str, Channels]) -> dict[str, Array]:
        """Measure the own share, add all shares up, and forward the newest share of every robot."""
        self._index = index
        for channels in inbox.values():
            for name, share in channels.items():
                if name != self._config.name and (name not in self._shares or share[0] > self._shares[name][0]):
                    self._shares[name] = share
        rests = own is not None and self._rests(own)
        if own is not None and rests:
            force, acceleration = own.samples[:, FORCE], own.samples[:, ACCELERATION]
            own_share = np.sum(force * acceleration) / np.sum(acceleration**2)
            self._shares[self._config.name] = np.array([index, own_share])
        team = self._gossip.graph
        if not rests or team is None or self._missing(team):
            self._sums.clear()
        else:
            self._add(float(sum(self._shares[name][1] for name in team)))
        return dict(self._shares)

    def fits(self, channels: Channels) -> bool:
        """Whether all of a neighbour's channels are shares."""
        return all(share.shape == (2,) for share in channels.values())

    def belief(self) -> Belief:
        """Return the mass. The estimate never converges, because the rest stays unknown."""
        unknown = (f"centre of mass: {_NOT_MEASURED}", f"inertia: {_NOT_MEASURED}")
        if not self._is_known:
            return Belief("inertia", False, None, {}, not_observable=(*self.doubts(), *unknown))
        # Errors of successive blocks are correlated, so the mean is not taken to be more certain than one of them.
        covariance = np.array([[np.var(self._sums)]])
        payload = PayloadEstimate(mass=float(np.mean(self._sums)), com=None, tensor=None, covariance=covariance)
        return Belief("inertia", False, payload, {}, not_observable=unknown, learned_block=self._index)

    def doubts(self) -> tuple[str, ...]:
        """Return why there is no mass now."""
        if self._is_known:
            return ()
        who = ", ".join(self._missing(self._gossip.graph or ())) or "the payload"
        return (f"mass: {who} has not rested long enough",)

    def _add(self, mass: float) -> None:
        """Add a sum; one that is far from all before belongs to another load."""
        if self._is_known and abs(mass - np.mean(self._sums)) > _JUMP * np.std(self._sums):
            self._sums.clear()
        self._sums.append(mass)

    @property
    def _is_known(self) -> bool:
        return len(self._sums) >= max(2, self._config.blocks(_LEAST))

    def _rests(self, own: MeasurementBlock) -> bool:
        """Whether the payload turns and shakes so little during a block that it can be weighed."""
        turning = np.linalg.norm(own.samples[:, GYRO].mean(axis=0))
        shaking = abs(np.linalg.norm(own.samples[:, ACCELERATION].mean(axis=0)) - _GRAVITY)
        return bool(turning < self._settings.turning and shaking < self._settings.shaking)

    def _missing(self, team: Collection[str]) -> list[str]:
        """Return robots without a new share: it is forwarded once per block, so its age is the number of hops."""
        oldest = self._index - len(team) - 1
        return [name for name in team if name not in self._shares or self._shares[name][0] < oldest]
