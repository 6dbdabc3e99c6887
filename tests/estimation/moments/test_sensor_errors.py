"""Errors of sensors: each generator is the derivative of what a sensor with this error reads."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from coheft.estimation.geometry.spatial import Array, rotation_exp
from coheft.estimation.moments.rows import PRODUCTS, ROW_SIZE, SLOPE, A, V, W
from coheft.estimation.moments.sensor_errors import KINDS, ONE, RATES, SensorErrors
from coheft.estimation.rigid_body.regressor import symmetric_products

FORCE, TORQUE = slice(12, 15), slice(15, 18)
SENSORS = {"gyro": W, "velocity": V, "acceleration": A, "force": FORCE, "torque": TORQUE}
STEP = 1e-6


def extended_row(seed: int, width: int) -> Array:
    """With products that belong to its angular velocity, and their rates to its slope."""
    x = np.random.default_rng(seed).normal(size=width)
    x[ONE], x[PRODUCTS] = 1.0, symmetric_products(x[None, W])[0]
    if width > RATES + ROW_SIZE - 1:
        rate = x[RATES + np.arange(3)]
        x[RATES + 18 : RATES + ROW_SIZE] = (
            symmetric_products((x[W] + rate)[None]) - symmetric_products((x[W] - rate)[None])
        )[0] / 2.0
    return x


def corrected(x: Array, kind: str, eta: Array) -> Array:
    """An extended row without a small error, by its physical meaning."""
    result, has_rates = x.copy(), len(x) >= RATES + ROW_SIZE
    if kind == "acceleration_bias":
        result[A] += eta
    elif kind == "clock":
        result[:ROW_SIZE] += eta[0] * x[RATES : RATES + ROW_SIZE]
    elif kind == "wrench_delay":
        result[12:18] += eta[0] * x[RATES + 12 : RATES + 18]
    elif kind == "grasp_compliance":
        result[V] += eta[0] * x[-6:-3]
        result[A] += eta[0] * x[-3:]
    elif kind.endswith("_place"):
        for first in (0, RATES) if has_rates else (0,):
            own, changed = x[first : first + 24], result[first : first + 24]
            if kind == "velocity_place":
                changed[V] += np.cross(own[W], eta)
            else:
                products = own[PRODUCTS][[0, 3, 4, 3, 1, 5, 4, 5, 2]].reshape(3, 3)
                changed[A] += np.cross(own[SLOPE], eta) + products @ eta - np.trace(products) * eta
    else:
        sensor, _, what = kind.partition("_")
        if what == "gain":
            matrix = (1.0 + eta[0]) * np.eye(3)
        elif what == "scale":
            matrix = np.diag(1.0 + eta)
        elif what == "mounting":
            matrix = rotation_exp(eta)
        else:
            x_, y_, z_ = eta
            matrix = np.eye(3) + np.array([[0.0, z_, y_], [z_, 0.0, x_], [y_, x_, 0.0]])
        for first in (0, RATES) if has_rates else (0,):
            own = result[first : first + ROW_SIZE]
            own[SENSORS[sensor]] = matrix @ own[SENSORS[sensor]]
            if sensor == "gyro":
                own[SLOPE] = matrix @ own[SLOPE]
        if sensor == "gyro":
            result[PRODUCTS] = symmetric_products(result[None, W])[0]
            if has_rates:
                w, rate = result[W], result[RATES : RATES + 3]
                outer = symmetric_products((w + rate)[None]) - symmetric_products((w - rate)[None])
                result[RATES + 18 : RATES + ROW_SIZE] = outer[0] / 2.0
    return result


@pytest.mark.parametrize("has_rates", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_generators_are_derivatives_of_the_physical_errors(kind: str, has_rates: bool) -> None:
    errors = SensorErrors({kind: 0.01, "clock": 0.001} if has_rates else {kind: 0.01})
    x = extended_row(1, errors.width)
    own = [k for k, name in enumerate(errors.names) if name == kind]
    for axis, k in enumerate(own):
        eta = np.zeros(len(own))
        eta[axis] = STEP
        derivative = (corrected(x, kind, eta) - corrected(x, kind, -eta)) / (2.0 * STEP)
        np.testing.assert_allclose(errors.generators[k] @ x, derivative, atol=1e-8)


@pytest.mark.parametrize("kind", KINDS)
def test_numbers_of_parameters(kind: str) -> None:
    errors = SensorErrors({kind: 0.01})
    is_single = kind.endswith("_gain") or kind in ("clock", "wrench_delay", "grasp_compliance")
    assert errors.count == (1 if is_single else 3)
    assert errors.names == (kind,) * errors.count
    assert errors.has_rates == (kind in ("clock", "wrench_delay"))
    assert errors.is_flexing == (kind == "grasp_compliance")
    assert errors.width == 25 + 24 * errors.has_rates + 6 * errors.is_flexing


def test_all_kinds_together_keep_their_order_and_deviations() -> None:
    errors = SensorErrors({kind: 0.01 * (1 + k) for k, kind in enumerate(reversed(KINDS))})
    assert list(dict.fromkeys(errors.names)) == list(KINDS)
    expected = {kind: 0.01 * (1 + k) for k, kind in enumerate(reversed(KINDS))}
    expected["clock"] *= np.sqrt(2.0)  # it counts from that of another robot
    np.testing.assert_allclose(errors.deviations, [[expected[name] for name in errors.names]])


def test_what_is_exact_is_no_parameter() -> None:
    assert SensorErrors({}).count == SensorErrors({"gyro_gain": 0.0, "clock": 0.0}).count == 0
    assert not SensorErrors({"clock": 0.0}).has_rates


def test_an_unknown_kind_is_refused_with_a_list_of_kinds() -> None:
    with pytest.raises(ValueError, match=r"'gyro_drift' are not known; there are") as refused:
        SensorErrors({"gyro_gain": 0.1, "gyro_drift": 0.1})
    assert all(kind in str(refused.value) for kind in KINDS)


@given(st.integers(0, 10_000))
def test_products_follow_the_gyro(seed: int) -> None:
    errors = SensorErrors({"gyro_scale": 0.01, "gyro_mounting": 0.01, "gyro_cross_talk": 0.01, "gyro_gain": 0.01})
    rng, x = np.random.default_rng(seed), extended_row(seed, errors.width)
    calibrated = errors.step(1e-3 * rng.normal(size=(1, errors.count)))[0] @ x
    np.testing.assert_allclose(calibrated[PRODUCTS], symmetric_products(calibrated[None, W])[0], atol=1e-9)


def test_a_step_is_the_exponential_to_third_order() -> None:
    errors = SensorErrors(dict.fromkeys(KINDS, 0.01))
    eta = np.random.default_rng(2).normal(size=(3, errors.count))

    def missing(size: float) -> Array:
        exact = expm(np.tensordot(size * eta, errors.generators, axes=1))
        return np.abs(errors.step(size * eta) - exact).max(axis=(1, 2))

    ratios = missing(0.02) / missing(0.01)
    np.testing.assert_allclose(ratios, 16.0, rtol=0.05)
    np.testing.assert_array_equal(errors.step(0.0 * eta), np.broadcast_to(np.eye(errors.width), (3, 55, 55)))
