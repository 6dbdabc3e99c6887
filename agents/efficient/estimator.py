"""The estimator of one robot: a block and its neighbours' messages in, a message and a belief out.

block -> rows -> exchange -> complete rows -> session -> claims
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from coheft.agents.efficient.exchange import RowMessage
from coheft.agents.efficient.judge import Outcome, Verdict
from coheft.agents.efficient.settings import Guards
from coheft.agents.efficient.stages import Stage
from coheft.agents.efficient.team import Team
from coheft.agents.efficient.unnoticed import UnnoticedStep
from coheft.agents.estimator import MOST_NOTICES, Belief, Channels, RowSigner, is_converged
from coheft.consensus.gossip import Gossip
from coheft.estimation.geometry.body_motion import relative_pose_derivative
from coheft.estimation.geometry.uncertain_pose import UncertainPose
from coheft.estimation.measurement import MeasurementBlock
from coheft.estimation.moments.claims import Claim, claim_of, found_errors
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.undeclared import UndeclaredError
from coheft.estimation.tolerance import SENSOR_NAMES
from coheft.wire.config import AgentConfig
from coheft.wire.messages.structs import LoadChangeNotice, PayloadEstimate, SensorErrorEstimate, SlipNotice
from coheft.wire.scenario.robot_sensors import TEAM_NEEDS

NO_LOAD_AT_POSES = (
    "wrenches fit no load at the poses found so far: turn the load about other axes as well; if that does not help, "
    "a force or torque sensor is off"
)
"""Reason why nothing is valid if not all poses are known: residuals of wrenches may be due to wrong poses."""


class EfficientEstimator:
    """The default estimator. See ``coheft.agents.estimator.Estimator``."""

    def __init__(self, config: AgentConfig, gossip: Gossip) -> None:
        self._config, self._gossip, self._guards = config, gossip, Guards()
        self._signer: RowSigner | None = None
        self._team: Team | None = None
        self._late: list[tuple[str, Channels]] = []  # messages of earlier blocks by their senders, since the last step
        self._lacks: str | None = None  # a sensor that no robot of the team has, but one needs
        self._belief = Belief("poses", False, None, {})
        # What the belief was computed from: it is computed anew if any of this differs.
        self._believed: tuple[Estimate, Stage, int, int, UnnoticedStep, int | None] | None = None
        self._former_changes: tuple[LoadChangeNotice, ...] = ()
        self._former_slips: tuple[SlipNotice, ...] = ()

    def step(self, index: int, own: MeasurementBlock | None, inbox: Mapping[str, Channels]) -> dict[str, Any]:
        """See ``Estimator.step``."""
        membership = self._gossip.membership
        if self._team is None or membership != self._team.exchange.team:
            self._join(membership, index)
        team, received = self._team, [*self._late, *inbox.items()]
        self._late.clear()
        if team is None:
            return {}
        messages, is_welcoming = list[RowMessage](), False
        for name, channels in received:
            message = RowMessage.of_channels(channels, name)
            if message is not None and message.team == team.exchange.team:
                messages.append(message)
                team.receive_seals(channels, index)
                team.adopt(channels)
                is_welcoming |= team.welcomes(name)
        team.exchange.receive(messages, index)
        team.look_closely_after(index)
        if own is not None and index >= team.start:
            team.enter(index, own.samples)
        team.take(index)
        arrays: dict[str, Any] = team.exchange.message(team.session.causes.news_at).channels() | team.seal_channels()
        if is_welcoming:
            arrays |= team.known()
        return arrays

    def receive_late(self, sender: str, channels: Channels) -> None:
        """See ``TakesLate.receive_late``: the message counts as any other."""
        self._late.append((sender, channels))

    def sign_with(self, signer: RowSigner) -> None:
        """See ``SignsRows.sign_with``; called before the first step."""
        self._signer = signer

    def refused(self) -> list[str]:
        """See ``SignsRows.refused``."""
        return [] if self._team is None else self._team.refused()

    def fits(self, channels: Channels) -> bool:
        """See ``Estimator.fits``."""
        return not channels or RowMessage.of_channels(channels) is not None

    def doubts(self) -> tuple[str, ...]:
        """See ``Estimator.doubts``."""
        team = self._team
        if self._lacks is not None:
            return (f"no robot that holds the load has a {SENSOR_NAMES[self._lacks]}, but one is needed",)
        if team is None:
            return ("the team is not known yet",)
        session = team.session
        if session.undeclared is not None:
            where, what = _undeclared_in_words(session.undeclared, team.names)
            return (f"{where} seems to {what}, but is declared to be exact",)
        if session.stage is not Stage.ESTIMATING and session.verdict.outcome is not Outcome.FITS:
            is_pose_unknown = session.estimate is not None and session.estimate.misses_poses
            if session.verdict.outcome is Outcome.NO_LOAD and is_pose_unknown:
                return (NO_LOAD_AT_POSES,)
            return (_in_words(session.verdict, team.names),)
        if session.estimate is None and not team.missing():
            return ("the team's measurements have just begun",)
        if session.suspected is not None:
            where, what = _undeclared_in_words(session.suspected, team.names)
            return (f"{where} may {what}, though it is declared to be exact: more samples will tell",)
        if session.contradicting is not None:
            return (f"the sensors of {team.names[session.contradicting]} contradict the motion of the team",)
        if session.causes.is_open:
            return ("either the load has changed or a grasp has slipped",)
        if not session.is_confirmed:
            return ("what was known before is being confirmed by new measurements",)
        disputed = team.disputed(self._config.blocks(self._guards.confirming))
        if disputed:
            whose = ", ".join(disputed)
            return (f"different rows of {whose} have come for one time: it, or a robot that hands them on, is wrong",)
        missing = team.missing()
        if missing:
            since = self._config.start_of(team.newest + 1)
            return (f"measurements of {', '.join(missing)} are missing since {since:.2f} s",)
        return ()

    def belief(self) -> Belief:
        """See ``Estimator.belief``."""
        team = self._team
        if team is not None and team.session.estimate is not None:
            session, estimate = team.session, team.session.estimate
            now = (
                estimate,
                session.stage,
                len(session.causes.certain_changes),
                len(session.causes.slips),
                session.unnoticed.step,
                None if session.load_drift is None else team.newest,  # the estimate lags behind more and more
            )
            if now != self._believed:
                self._belief, self._believed = self._belief_of(team, estimate), now
            self._belief = replace(self._belief, learned_block=team.newest)
            if session.total_wrench is not None:
                wrench = estimate.state.poses[team.own].inverse().adjoint() @ session.total_wrench
                self._belief = replace(self._belief, total_block=team.newest, total_wrench=wrench)
        return self._belief

    def _join(self, membership: int, index: int) -> None:
        """Start with another team, using what was learned in the last one as prior."""
        graph, last, name = self._gossip.graph, self._team, self._config.name
        if last is not None:
            self._former_changes, self._former_slips = self._notices(last), self._slips(last)
        if graph is None or name not in graph:
            self._team = self._lacks = None
            return
        missing = [self._config.sensors_of(each).missing for each in graph]
        self._lacks = next((sensor for sensor in TEAM_NEEDS if all(sensor in each for each in missing)), None)
        if self._lacks is not None:
            self._team = None
            return
        # A robot that has restarted, or has let go in between, is another one.
        records, start = [self._gossip.records[each] for each in sorted(graph)], max(index, self._gossip.changed_at)
        identities = [(record.robot, record.incarnation, record.since) for record in records]
        self._team = Team(identities, membership, graph, start, self._config, self._guards, self._signer)
        if last is not None:
            self._hand_over(last, self._team)

    def _hand_over(self, last: Team, team: Team) -> None:
        """Begin with what the last team has learned, if it can be relied upon."""
        missing = self._config.start_of(team.start) - self._config.start_of(last.newest + 1)
        known = last.session.hand_over(max(0.0, missing))
        if known is None:
            return
        indices = [last.indices.get(identity) for identity in team.indices]
        newcomers = [name for name, then in zip(team.names, indices, strict=True) if then is None]
        anchor = next((now for now, then in enumerate(indices) if then is not None), None)
        if anchor is not None:  # else all have let go and grasped the load again since
            team.begin(known.for_team(indices, last.settings, team.settings), anchor, newcomers)

    def _notices(self, team: Team) -> tuple[LoadChangeNotice, ...]:
        start, first_block = self._config.start_of, team.times.first_block
        found = zip(team.noticed, team.session.causes.certain_changes, strict=False)
        new = (LoadChangeNotice(start(noticed + 1), start(first_block(change.first))) for noticed, change in found)
        return (*self._former_changes, *new)[-MOST_NOTICES:]

    def _slips(self, team: Team) -> tuple[SlipNotice, ...]:
        start, first_block = self._config.start_of, team.times.first_block
        new = (
            SlipNotice(team.names[slip.robot], start(noticed + 1), start(named + 1), start(first_block(slip.first)))
            for (noticed, named), slip in zip(team.noticed_slips, team.session.causes.slips, strict=True)
        )
        return (*self._former_slips, *new)[-MOST_NOTICES:]

    def _belief_of(self, team: Team, estimate: Estimate) -> Belief:
        """Return what this robot publishes of an estimate."""
        state, unknowns, own = estimate.state, estimate.body.unknowns, team.own
        estimate = team.session.claimable(estimate)
        claim = claim_of(estimate, own)
        poses, not_observable = {}, []
        for name in self._config.neighbours:
            if name not in team.names:
                continue
            other = team.names.index(name)
            if claim.hidden_poses[own] or claim.hidden_poses[other]:
                not_observable.append(f"pose of {name}: turn the load about other axes as well")
                continue
            derivative = relative_pose_derivative(state.poses[own], state.poses[other])
            indices = np.concatenate([unknowns.poses[own], unknowns.poses[other]])
            covariance = derivative @ estimate.covariance[np.ix_(indices, indices)] @ derivative.T
            poses[name] = UncertainPose(state.poses[own].inverse() @ state.poses[other], covariance)
        payload, errors = _payload(claim), found_errors(estimate, own, team.settings.errors)
        to_first, every = state.poses[0].inverse(), zip(team.names, state.poses, strict=True)
        return Belief(
            phase="poses" if payload is None and claim.hidden_poses.any() else "inertia",
            converged=payload is not None and is_converged(payload, self._config.converged),
            payload=payload,
            poses=poses,
            not_observable=(*not_observable, *claim.unobservable),
            load_changes=self._notices(team),
            slips=self._slips(team),
            sensor_errors=tuple(SensorErrorEstimate(*each) for each in errors),
            grasps={} if claim.hidden_poses.any() else {name: to_first @ pose for name, pose in every},
        )


def _in_words(verdict: Verdict, names: list[str]) -> str:
    """Say why the load is not known."""
    if (misreading := verdict.misreading) is not None:
        if misreading.robot is None:
            return f"wrenches fit no load, but would {misreading.words}"
        whose = names[misreading.robot]
        return f"wrenches fit no load, but would if those of {whose} {misreading.words}: is its driver right?"
    if verdict.rival is None:
        which = "" if verdict.robot is None else f"; {names[verdict.robot]} stands out"
        return verdict.outcome.value + which
    robot, sensor = verdict.rival
    which = f"a {sensor} sensor" if robot is None else f"the {sensor} sensor of {names[robot]}"
    return f"either the load has changed or {which} has an offset"


def _undeclared_in_words(found: UndeclaredError, names: list[str]) -> tuple[str, str]:
    """Say which sensor, and what is wrong with it."""
    whose = "a robot" if found.robot is None else names[found.robot]
    if found.kind == "clock":
        return f"the clock of {whose}", "be off"
    sensor, _, what = found.kind.partition("_")
    words = {"bias": "have an offset", "mounting": "be turned", "scale": "have another scale", "delay": "be late"}
    return f"the {SENSOR_NAMES.get(sensor, sensor)} of {whose}", words.get(what, "be elsewhere")


def _payload(claim: Claim) -> PayloadEstimate | None:
    """Convert a claim into the field of the message."""
    inertia = claim.inertia
    if inertia is None:
        return None
    return PayloadEstimate(
        inertia.mass,
        inertia.com if claim.known > 1 else None,
        inertia.tensor if claim.known > 4 else None,
        claim.covariance,
    )
