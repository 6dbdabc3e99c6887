"""An agent's reports to observers: its estimate, whether that is still valid, and if not, why."""

from collections.abc import Sequence

from coheft.agents.estimator import Belief
from coheft.agents.regular import Regular
from coheft.wire.config import AgentConfig
from coheft.wire.messages.structs import Estimate, PoseEstimate, Validity

_REPORT_INTERVAL = 0.1
"""Time between reports to observers [s]; a change between valid and doubted is reported at once."""


class StatusKeeper:
    """Turns estimates and doubts into reports, and keeps the last valid estimate."""

    def __init__(self, config: AgentConfig) -> None:
        self._config = config
        self._reports = Regular(config.blocks(_REPORT_INTERVAL))
        self._valid: Belief | None = None
        self._doubted = False
        self.problems = 0

    def is_due(self, index: int, doubts: Sequence[str]) -> bool:
        """Whether a report is due after this block: at times that are the same for all agents, and when doubts begin or
        end.
        """
        is_time = self._reports.is_due(index + 1)  # the block's end, so that reports are at round times
        return is_time or bool(doubts) != self._doubted

    def report(
        self, index: int, belief: Belief, doubts: Sequence[str], members: int, silent: Sequence[str] = ()
    ) -> Estimate:
        """Make a report after a block, of the estimator's belief and the reasons why it may not be valid now.

        ``members`` is the size of the team, 0 if unknown; ``silent`` are neighbours whose messages are missing.
        """
        self._doubted = bool(doubts)
        reasons = list(doubts)
        if not doubts and belief.payload is None:
            reasons = list(belief.not_observable) or ["too few samples of this load"]
        is_valid = not doubts and belief.payload is not None
        if is_valid:
            reasons = list(belief.shortfall)
            self._valid = belief
        published = self._valid or belief
        status = Validity.STARTING
        if self._valid is not None:
            status = Validity.VALID if is_valid else Validity.STALE
        return Estimate(
            robot=self._config.name,
            block=index,
            time=self._config.start_of(index + 1),
            phase=published.phase,
            converged=published.converged,
            members=members,
            payload=published.payload,
            poses={
                name: PoseEstimate(pose.pose.rotation, pose.pose.translation, pose.covariance)
                for name, pose in published.poses.items()
            },
            total_block=published.total_block,
            total_wrench=published.total_wrench,
            not_observable=list(published.not_observable),
            load_changes=list(belief.load_changes),
            problems=self.problems,
            status=status,
            reasons=reasons,
            valid_block=published.learned_block,
            silent=list(silent),
            estimator=self._config.estimator,
            sensor_errors=list(published.sensor_errors),
            slips=list(belief.slips),
        )
