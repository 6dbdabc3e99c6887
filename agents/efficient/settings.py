"""Thresholds and intervals of the default estimator: false-alarm probabilities, information ratios, times."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from coheft.agents.efficient.row_times import RowTimes
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.rows import RowNoise
from coheft.estimation.moments.sensor_errors import SensorErrors
from coheft.wire.config import AgentConfig

_LEAST_CONFIRMING = 3
"""Fewer rows are no confirmation, however long they are."""


def fit_settings(config: AgentConfig, names: Sequence[str]) -> FitSettings:
    """Return the settings of a robot's fits in a team of robots with these names."""
    drift, row = config.drift, RowTimes.of_team(len(names), config.block, config.rate).row
    sensors = [config.sensors_of(name) for name in names]
    sheets = [each.tolerance for each in sensors]
    anywhere = [config.tolerance, *(each.tolerance for each in config.unequal.values())]

    def offset(key: str, drifting: float) -> float | Array:
        own = np.maximum([getattr(sheet, key) for sheet in sheets], drifting)
        return float(own[0]) if (own == own[0]).all() else own

    noises, missing = [each.noise for each in sensors], [each.missing for each in sensors]
    return FitSettings(
        RowNoise.of_team(noises, row, config.rate, config.noise_correlation, missing),
        row / config.rate,
        SensorErrors.of(sheets, drift, anywhere),
        force_offset=offset("force_offset", drift.force),
        torque_offset=offset("torque_offset", drift.torque),
        gyro_offset=offset("gyro_offset", drift.gyro),
        drift=drift,
        memory=None if config.efficient.memory == "window" else config.efficient.memory,
    )


@dataclass(frozen=True)
class Guards:
    """Thresholds and times of one robot's session.

    Attributes:
        growth: A new fit is due when the number of rows of the load has grown by this factor: deviations have then
            shrunk by 7 %.
        growth_of_many: The same if sensor errors are declared, or in large teams, where fits cost more.
        first_rows: Time over which rows of a load are collected before it is fitted [s]: enough rotation to show faulty
            sensors. Twice as long if poses have to show as well, or if the last load was forgotten before it was known.
        turn: Each robot tests for a load change once in this time, in turn with the others [s].
        surprise: Probability that the wrench of one row is a surprise without a change; two in a row start a test.
        mass_surprise: Probability that the rows of the last ``shortest`` together show another mass without a change;
            this is tested after every row, and starts a test for changes, too.
        worth_a_fit: The second test for a change needs some fits. They are made if, with uncertain poses, the statistic
            is at least this share of its threshold: less than 1, because some rows may have been fitted already. If it
            reaches this share there, it is made again soon.
        contradiction: Probability that a robot's motion seems to contradict the team's over a window of rows without
            any fault. There are some 250 windows per second and robot, so this is one in many years.
        lasting: After a contradiction that lasts so long, poses may be wrong, and the robot starts over [s].
        after_gap: After missing rows, so long other loads and slips meanwhile are considered; if one is still likelier
            than none, the robot starts over [s].
        misfit: Probability that a stretch of rows fits so badly without any fault; a fit has some ten thousand.
        tolerance: Probability that a robot's sensor errors exceed their tolerances so much if these are right.
        undeclared: False-alarm probability for one kind of error of one robot whose tolerance is zero.
        undeclared_doubt: Share of its threshold from which on an undeclared error is suspected, and nothing is valid:
            some 5e-6 by chance for each kind and robot, one in 2200 for a test of six robots.
        undeclared_growth: The next test for undeclared errors is due when the number of rows has grown by this factor,
            in large teams by its square.
        undeclared_lasts: An undeclared error is over when rows do not show it for so long [s], or for as many rows.
        energy: Standard deviations by which the sum of all squared residuals may exceed its expectation.
        noise_tolerance: Share by which the variance of the noise may exceed its nominal value.
        offset: Probability that a sensor offset seems to explain the wrenches of another load by chance.
        fresh_change: Largest statistic of a change within the rows of a load that is fitted for the first time, over
            its threshold: some 1e-7 by chance.
        pose_step: Probability that a stretch of newest rows shows another pose of one grasp by chance.
        calm: A load that is forgotten again sooner than this is restless, and a contradiction of the same robot that
            returns sooner is still the same one [s].
        restless: If loads have been forgotten that soon, or before they were known, for so long [s], poses may be
            wrong, and the robot starts over.
        mass: Probability that the mass seems to have changed by chance, where a faulty sensor may be the cause instead.
        shortest: After so long, a step of the mass counts as long ago [s]: larger ones are noticed by then.
        small_step: Probability that one stretch of rows shows a small step of the mass by chance; a look tests some ten
            stretches that overlap.
        recent_step: The same probability if the step is more recent than ``shortest``: over so few rows, chance alone
            makes larger steps.
        small_step_fades: Share of a small step that is still covered after another look without a significant one: a
            step that is hardly visible is not significant in every look.
        drifting: A load that changes again so soon drifts [s].
        mistaken: Probability of taking a load change or a faulty sensor for a slip, or the other way round, if all are
            equally likely a priori: one cause has to be likelier than all others by this factor.
        doubted: While rows are less likely by this factor without a change than with one, nothing is valid. Only after
            rows were missing: at any other time a change is noticed as soon as it begins. A slip with another load
            has to be likelier than displaced motion sensors by as much, and the slip of one grasp than that of another.
        telling_apart: After so long without such a decision, a slip is no longer considered [s].
        undecided: After so long without a decision, the load counts as changed [s]: a fault is over by then.
        waiting: Rows are missing when no new row of the whole team has been complete for so long [s].
        outdated: An estimate whose newest row is late by more than this is not valid [s]: after a pause, old rows come.
        confirming: A robot that contradicted the team is trusted again after so long without a contradiction [s]. After
            that, after missing rows, or in another team, new rows have to fit for so long before the former estimate
            is valid again, because the load may have changed meanwhile.
        sealed_every: Each robot signs its rows once in this time [s].
        sealed_alike: In teams of more robots than this, robots sign less often in proportion: each checks all others.
        sealed_within: A signature arrives within this time after its last row [s], even if its first two messages are
            lost.
        distrusting: Copies of a robot's rows are used again after so long without a false one [s].
    """

    growth: float = 1.15
    growth_of_many: float = 1.3
    first_rows: float = 0.3
    turn: float = 0.48
    surprise: float = 4e-5
    mass_surprise: float = 0.003
    worth_a_fit: float = 0.5
    contradiction: float = 1e-11
    lasting: float = 1.5
    after_gap: float = 3.0
    misfit: float = 1e-13
    tolerance: float = 1e-8
    undeclared: float = 1e-9
    undeclared_doubt: float = 0.6
    undeclared_growth: float = 1.3
    undeclared_lasts: float = 2.5
    energy: float = 6.0
    noise_tolerance: float = 0.2
    offset: float = 1e-4
    fresh_change: float = 0.65
    pose_step: float = 1e-8
    calm: float = 1.0
    restless: float = 3.0
    mass: float = 1e-6
    shortest: float = 0.3
    small_step: float = 0.012
    recent_step: float = 1e-4
    small_step_fades: float = 0.5
    drifting: float = 12.0
    mistaken: float = 6e-6
    doubted: float = 0.005
    telling_apart: float = 1.2
    undecided: float = 3.2
    waiting: float = 0.15
    outdated: float = 1.0
    confirming: float = 0.1
    sealed_every: float = 0.5
    sealed_alike: int = 12
    sealed_within: float = 0.8
    distrusting: float = 1.5

    @property
    def lead(self) -> float:
        """Least margin of the likeliest cause's log ratio over all others."""
        return -math.log(self.mistaken)

    @property
    def doubt(self) -> float:
        """Log ratio of a change from which on nothing is valid."""
        return -math.log(self.doubted)


@dataclass(frozen=True)
class RowCounts:
    """The times of ``Guards`` as numbers of rows, each at least 1."""

    lasting: int
    after_gap: int
    undeclared_lasts: int
    calm: int
    restless: int
    shortest: int
    drifting: int
    telling_apart: int
    undecided: int
    waiting: int
    confirming: int
    turn: int

    @staticmethod
    def of(guards: Guards, period: float) -> RowCounts:
        """Convert the times, for rows of this period [s]."""
        counts = {each.name: max(1, round(getattr(guards, each.name) / period)) for each in fields(RowCounts)}
        return RowCounts(**counts | {"confirming": max(_LEAST_CONFIRMING, counts["confirming"])})
