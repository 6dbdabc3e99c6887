"""Wrenches of one robot that have another sign, unit or axes."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import pytest
from msgspec.structs import replace

from coheft.agents.efficient.judge import misreading
from coheft.agents.efficient.settings import Guards
from coheft.estimation.geometry.spatial import Array, rotation_exp
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.misread import Misreading, in_words
from coheft.estimation.moments.rows import ROW_SIZE, WRENCH, A, RowNoise
from coheft.estimation.moments.unknowns import State
from tests.efficient.rows import PERIOD, POSES, made_up_rows

NOISE = SensorNoise()
QUARTER_TURN = rotation_exp(np.array([0.0, 0.0, np.pi / 2.0])).round()


def read(factor: Array, *robots: int, pushing: Collection[int] = range(len(POSES))) -> Array:
    """Rows in which wrenches of these robots are multiplied by a factor (6, 6); some push against each other, too."""
    rows = made_up_rows(60)
    wrenches = [rows[:, ROW_SIZE * robot :][:, WRENCH] for robot in range(len(POSES))]
    pushes = np.random.default_rng(1).normal(size=(len(pushing), len(rows), 6))
    for robot, push in zip(pushing, pushes - pushes.mean(axis=0), strict=True):
        wrenches[robot] += 20.0 * push @ POSES[robot].inverse().adjoint().T
    for robot in robots:
        wrenches[robot][:] = wrenches[robot] @ factor.T
    return rows


def found(rows: Array, noise: SensorNoise = NOISE) -> Misreading | None:
    settings = FitSettings(RowNoise.of_samples(noise, 20, 1000.0), PERIOD)
    return misreading(settings.body(State.first(list(POSES), settings.errors)), rows, Guards())


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (-np.eye(6), "had the opposite sign"),
        (np.eye(6) / 9.81, "were 9.81 times as large"),
        (0.8 * np.eye(6), "were 1.25 times as large"),
        (np.diag([1.0, 1.0, 1.0, 0.1, 0.1, 0.1]), "had torques 10 times as large"),
        (np.kron(np.eye(2), QUARTER_TURN), "were turned by 90° about (0.0, 0.0, -1.0)"),
        (np.kron(np.eye(2), rotation_exp(np.array([0.14, 0.0, 0.0]))), "were turned by 8° about (-1.0, 0.0, 0.0)"),
        (-np.kron(np.eye(2), QUARTER_TURN), "had the opposite sign and were turned by 90° about (0.0, 0.0, -1.0)"),
    ],
)
def test_it_is_found_and_told(factor: Array, words: str):
    is_so = found(read(factor, 2))
    assert is_so is not None
    assert (is_so.robot, is_so.words) == (2, words)


def test_an_offset_is_found_and_told():
    rows = read(np.eye(6))
    rows[:, ROW_SIZE * 2 :][:, WRENCH] += [0.0, 20.0, 0.0, 0.0, 0.0, 0.0]
    is_so = found(rows)
    assert is_so is not None
    assert (is_so.robot, is_so.words) == (None, "with a constant offset: has a sensor not been tared?")


def test_the_noise_of_the_motion_counts_as_well():
    rows, poor = read(-np.eye(6), 2), replace(NOISE, acceleration=1.0)
    for robot in range(len(POSES)):
        own = rows[:, ROW_SIZE * robot :][:, A]
        own += np.random.default_rng(robot).normal(scale=poor.acceleration / np.sqrt(20.0), size=own.shape)
    is_so = found(rows, poor)
    assert is_so is not None
    assert is_so.words == "had the opposite sign"


def test_nothing_is_told_where_wrenches_fit_or_an_error_of_a_sensor_explains_them():
    assert found(read(np.eye(6))) is None
    assert found(read(0.95 * np.eye(6), 2)) is None


def test_where_it_might_be_either_of_two_none_is_named():
    """Two push against each other, and all bear constant shares of the load: either may have the opposite sign."""
    assert found(read(-np.eye(6), 1, pushing=(1, 3))) is None


def test_two_are_not_explained_by_another_one():
    """Nor by a load whose mass is below zero, to which the two others would fit."""
    assert found(read(-np.eye(6), 1, 2, 3)) is None
    assert found(read(-np.eye(6), 1, 2)) is None


def test_a_robot_whose_wrenches_need_not_be_read_at_all_is_not_told_to_scale_them():
    rows = made_up_rows(60)  # all robots have constant shares of the load, so all but one fit a smaller load
    rows[:, ROW_SIZE:][:, WRENCH] += np.random.default_rng(1).normal(size=(len(rows), 6))
    assert found(rows) is None


def test_axes_that_are_not_at_right_angles_are_not_told_as_a_turn():
    skewed = np.eye(3) + np.array([[0.0, 0.8, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    assert found(read(np.kron(np.eye(2), skewed), 2)) is None


def test_a_frozen_sensor_is_not_misread():
    rows = read(np.eye(6))
    rows[:, WRENCH] = rows[0, WRENCH]
    assert found(rows) is None


def test_a_factor_of_nearly_nothing_is_no_unit():
    assert in_words(1e-5 * np.eye(6)) == ""
    assert in_words(np.kron(np.diag([1.0, 0.0]), np.eye(3))) == ""
