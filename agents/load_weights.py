"""How an agent weighs samples of the load, and what the load is by these weights, with the poses in use."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from agents.disturbance import Disturbance
from agents.load_moments import number_of_samples
from coheft.estimation.inertia import GRAM_SIZE, InertiaInformation, InertiaModel, unpacked_gram
from coheft.estimation.inertia_estimate import InertiaEstimate, InertiaSolution, middle_and_size, solve_inertia
from coheft.estimation.load_samples import Memory
from coheft.estimation.motion_fusion import MotionFusion
from coheft.estimation.pose_disturbance import wrench_disturbance
from coheft.estimation.pose_sensitivity import PoseSensitivity, inertia_by_poses
from coheft.estimation.spatial import Array, Pose
from coheft.estimation.team_registration import TeamPoses
from coheft.wire.config import AgentConfig


class LoadWeights:
    """Weights of one agent's samples.

    The motions' noise is felt as a load makes it felt, so weights depend a little on what the load is: as long as that
    is not known, samples are weighed as if motions had no noise.

    Args:
        config: The agent's settings.
        poses: Of all robots, in the body frame.
        fusion: Of their motion sensors, at these poses.
        disturbance: What poses do to wrenches, shared with the memory: its size is set here, and told to every model.

    Attributes:
        model: The weights.
    """

    def __init__(
        self, config: AgentConfig, poses: Sequence[Pose], fusion: MotionFusion, disturbance: Disturbance
    ) -> None:
        self._noise = config.noise
        self._with_offset = config.efficient.offsets
        self._disturbance = disturbance
        self._parameters: Array | None = None
        # Of so many samples the load was learned; 0 if they were of another one.
        self._learned_of = 0.0
        self._see(poses, fusion)
        self._make_model()

    def set_poses(self, poses: Sequence[Pose], fusion: MotionFusion, window: Memory | None) -> None:
        """From now on samples are seen with these poses; ``window`` holds those that are, if there are enough."""
        self._see(poses, fusion)
        if window is None:
            self._make_model()
        else:
            self.learn(window)

    def learn(self, window: Memory) -> None:
        """From now on the load is what these samples say."""
        self._parameters = self.solution(window.information(self.model)).parameters
        self._learned_of = number_of_samples(window.total)
        self._make_model()

    def begin(self) -> None:
        """The load is another one, to be learned as soon as there are samples enough; till then weights stay."""
        self._learned_of = 0.0

    def are_due(self, count: float) -> bool:
        """Whether the load is to be learned of so many samples: when there are twice as many as there were."""
        return count >= 2.0 * self._learned_of

    @property
    def know_load(self) -> bool:
        """Whether it is known how much the motions' noise is felt: until then samples cannot be told apart."""
        return self._parameters is not None

    def _see(self, poses: Sequence[Pose], fusion: MotionFusion) -> None:
        self._poses, self._fusion = poses, fusion
        self._middle_and_size = middle_and_size(poses)
        self._sensitivity = PoseSensitivity.of(poses, self._noise, fusion.slope_information)

    def _make_model(self) -> None:
        self.model = InertiaModel(
            self._fusion.wrench_covariance,
            self._fusion.acceleration_covariance,
            self._parameters,
            with_offset=self._with_offset,
        )
        self._disturbance.tell(self.model)

    def expect_disturbance(self, forces: Array, team: TeamPoses) -> None:
        """From now on samples are spoilt, beside their noise, by what poses do to forces.

        Args:
            forces: Everybody's mean square force (N,) [N²].
            team: The poses in use, and how well they are known.
        """
        covariance = wrench_disturbance(self._poses, team.covariance, forces)
        self._disturbance.expect(covariance, self._fusion.wrench_covariance)
        self._disturbance.tell(self.model)

    @property
    def size(self) -> float:
        """Of the load, roughly [m]."""
        return self._middle_and_size[1]

    def solution(self, information: InertiaInformation) -> InertiaSolution:
        """What the load is."""
        return solve_inertia(information, *self._middle_and_size)

    def estimate(
        self, information: InertiaInformation, sums: Array, crosses: Array, other_errors: Array, team: TeamPoses
    ) -> tuple[InertiaEstimate, Array]:
        """What the load is, as far as bodies can exist.

        Args:
            information: Of the samples.
            sums: Of the samples, packed Gram matrix (190,) first.
            crosses: Of the motion's features with each robot's own wrench, shape (N, 13, 6).
            other_errors: Covariance (10, 10) of ``theta`` beside that by noise.
            team: The poses in use, and how well they are known.

        Returns:
            It, poses' errors not among its own; and the derivative of ``theta`` by all poses, shape (10, 6 N).
        """
        solution = self.solution(information)
        solution = replace(solution, covariance=solution.covariance + other_errors)
        gram = unpacked_gram(sums[:GRAM_SIZE])
        by_poses = inertia_by_poses(self.model, information, solution.parameters, gram, crosses, self._sensitivity)
        return solution.made_possible(by_poses @ team.covariance @ by_poses.T), by_poses
