"""Thresholds and intervals of the default estimator: false-alarm probabilities, information ratios, times."""

from __future__ import annotations

import math
from dataclasses import dataclass

from coheft.agents.efficient.row_times import RowTimes
from coheft.estimation.chi_square import chi_square_threshold
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.rows import KINEMATICS_SIZE, WRENCH_SIZE, RowNoise
from coheft.estimation.moments.sensor_errors import SensorErrors
from coheft.wire.config import AgentConfig


def fit_settings(config: AgentConfig, count: int) -> FitSettings:
    """What a robot's fits take for granted in a team of so many."""
    told, drift, row = config.tolerance, config.drift, RowTimes.of_team(count, config.block, config.rate).row
    return FitSettings(
        RowNoise.of_samples(config.noise, row, config.rate, config.noise_correlation),
        row / config.rate,
        SensorErrors.of(told, drift),
        force_offset=max(told.force_offset, drift.force),
        torque_offset=max(told.torque_offset, drift.torque),
        gyro_offset=max(told.gyro_offset, drift.gyro),
        drift=drift,
        memory=None if config.efficient.memory == "window" else config.efficient.memory,
    )


@dataclass(frozen=True)
class Guards:
    """Of one robot's session.

    Attributes:
        growth: All is fitted anew when the load has so many times as many rows: its deviations have then shrunk by 7 %.
        growth_of_many: The same where sensors' errors are declared, or robots are many: such fits cost more.
        first_rows: Time over which rows of a load are gathered before it is fitted [s], twice as long where nothing is
            known: enough turning to see poses, and sensors that are off.
        turn: Each robot looks for a change of the load once in this time, in turn with the others [s].
        surprise: Probability that the wrench of one row is a surprise without a change; two in a row are looked at.
        worth_a_fit: A second look needs two fits. It is worth them if, poses being uncertain, a change is at least so
            surprising, over the threshold: less than 1, because some of these rows may have been fitted already.
        contradiction: Probability that a robot's motion seems to contradict the team's over a window of rows without
            any fault. There are some 250 windows per second and robot, so this is one in many years.
        lasting: A contradiction that lasts so long may be the poses' own: all begins anew [s].
        misfit: Probability that a stretch of rows fits as badly as that without any fault; a fit has some ten thousand.
        tolerance: Probability that the sensors of a robot are off by so much more than told, if tolerances are right.
        undeclared: Probability that the errors of one kind of one robot seem to be there by chance, if told to be zero.
        undeclared_growth: They are looked for when the load has so many times as many rows as the last time.
        undeclared_lasts: What has asked for them once is over when it does not for so long [s], or for as many rows.
        energy: Standard deviations by which the sum of squares of all residuals may be larger than noise makes it.
        noise_tolerance: Share by which the variance of noise may be larger than it was told to be.
        excess: Probability that a sensor seems to explain wrenches of another load, without reading anything in excess.
        constant_excess: Probability that one seems to have read something in excess all the time, whatever the load is.
        fresh_change: Before a load is told for the first time no stretch of its rows may look so much like another one,
            over the threshold of a change: some 1e-7 by chance.
        calm: A load that is forgotten sooner after another one than this needs twice as many rows [s]: then it may be a
            sensor that comes and goes, and rows may be of both.
        mass: Probability that the mass seems to be another one by chance, where a sensor may be off instead.
        shortest: Steps of the mass that are too small to be noticed are sought over so long at least [s]: larger ones
            are noticed by then.
        small: A change of the mass by less than this share is a step: if it explains all rows, the load is not
            forgotten, but loosened.
        explained: Rows are explained by a step if what is left of the surprise is less than this, over its threshold:
            some 1e-4 by chance.
        mistaken: Probability that a slip is told although another load, or a sensor, is the cause, or the other way
            round, if both are equally likely beforehand: by so much one has to be likelier than all others.
        telling_apart: After so long without that no slip is told any more [s].
        undecided: After so long without an answer the load is believed to have changed [s]: a fault is over by then.
        waiting: Rows are missing when none of the whole team has come for so long, and the time on the way [s].
        confirming: A robot that contradicted the team, or itself, is believed again after so long without that [s].
            After that, after rows were missing, or in another team, what was known holds only when it has fitted new
            rows for so long: the load may have changed meanwhile.
    """

    growth: float = 1.15
    growth_of_many: float = 1.3
    first_rows: float = 0.3
    turn: float = 0.48
    surprise: float = 4e-5
    worth_a_fit: float = 0.5
    contradiction: float = 1e-11
    lasting: float = 1.5
    misfit: float = 1e-13
    tolerance: float = 1e-8
    undeclared: float = 1e-9
    undeclared_growth: float = 1.5
    undeclared_lasts: float = 2.5
    energy: float = 6.0
    noise_tolerance: float = 0.2
    excess: float = 1e-4
    constant_excess: float = 1e-9
    fresh_change: float = 0.65
    calm: float = 1.0
    mass: float = 1e-6
    shortest: float = 0.3
    small: float = 0.03
    explained: float = 0.4
    mistaken: float = 6e-6
    telling_apart: float = 1.2
    undecided: float = 4.0
    waiting: float = 0.15
    confirming: float = 0.1

    @property
    def largest_surprise(self) -> float:
        """Chi-square of a row's wrench."""
        return chi_square_threshold(WRENCH_SIZE, self.surprise)

    @property
    def largest_motion_misfit(self) -> float:
        """Chi-square of a robot's motion over a stretch of rows."""
        return chi_square_threshold(KINEMATICS_SIZE, self.misfit)

    @property
    def largest_wrench_misfit(self) -> float:
        """Chi-square of the wrench over a stretch of rows."""
        return chi_square_threshold(WRENCH_SIZE, self.misfit)

    @property
    def largest_excess(self) -> float:
        """Chi-square of a sensor's excess, three degrees of freedom, less these."""
        return chi_square_threshold(3, self.excess) - 3.0

    @property
    def least_mass_change(self) -> float:
        """Chi-square of a change of the mass."""
        return chi_square_threshold(1, self.mass)

    @property
    def largest_constant_excess(self) -> float:
        """Chi-square of a sensor's excess beside a load, three degrees of freedom, less these."""
        return chi_square_threshold(3, self.constant_excess) - 3.0

    @property
    def lead(self) -> float:
        """By which the log ratio of one cause exceeds all others."""
        return -math.log(self.mistaken)

    @property
    def largest_contradiction(self) -> float:
        """Chi-square of a robot's motion over a window."""
        return chi_square_threshold(KINEMATICS_SIZE, self.contradiction)
