"""The cart in the engine: against the model of the estimators, which shares nothing with it, and against physics."""

from __future__ import annotations

import subprocess
import sys

import msgspec
import mujoco
import numpy as np
import pytest
from msgspec import structs
from scipy.integrate import solve_ivp

from coheft.app.cart.table_one import table_one
from coheft.errors import ScenarioError, SimulationError
from coheft.estimation.cart.model import forward_dynamics, mass_matrix
from coheft.estimation.geometry.spatial import Array
from coheft.physics_server.cart.physics import CartSimulation, Casters, with_load
from coheft.wire.cart.config import CartServerConfig
from coheft.wire.cart.messages import CartPush
from coheft.wire.cart.scenario import CartLoad, CartScenario

QUIET = structs.replace(table_one(5), noise=0.0)


def push(
    block: int, wrench: tuple[float, float, float], hand: tuple[float, float] = (-0.25, 0.1)
) -> dict[str, CartPush]:
    return {"p1": CartPush(robot="p1", block=block, answers=block - 2, wrench=np.array(wrench), hand=np.array(hand))}


def drive(scenario: CartScenario, samples: int) -> list[Array]:
    """True motions under a push that turns and changes."""
    simulation = CartSimulation(scenario)
    return [
        simulation.advance(push(k, (30.0, 5.0 * np.sin(0.02 * k), 2.0 * np.cos(0.05 * k)))).truth.motion
        for k in range(samples)
    ]


def test_it_moves_as_the_model_says() -> None:
    simulation = CartSimulation(QUIET)
    body, motion = QUIET.cart, np.zeros(6)
    for k in range(200):
        truth = simulation.advance(push(k, (30.0, 5.0 * np.sin(0.02 * k), 2.0 * np.cos(0.05 * k)))).truth
        np.testing.assert_allclose(truth.motion, motion, atol=2e-5)

        def rate(_: float, state: Array, wrench: Array = truth.wrench) -> Array:
            moved = forward_dynamics(body.phi, body.friction, state[2], state[3:], wrench)
            return np.concatenate([state[3:], moved.accelerations])

        motion = solve_ivp(rate, (0.0, 0.01), motion, rtol=1e-9, atol=1e-12).y[:, -1]


def test_the_engine_has_the_same_mass_matrix() -> None:
    simulation = CartSimulation(QUIET)
    simulation.data.qpos[:] = 0.4, -1.0, 0.7
    mujoco.mj_forward(simulation.model, simulation.data)
    found = np.empty((3, 3))
    mujoco.mj_fullM(simulation.model, simulation.data, found)
    np.testing.assert_allclose(found, mass_matrix(QUIET.cart.phi, 0.7), atol=1e-12)


def test_wheels_do_not_slip() -> None:
    for motion in drive(QUIET, 1000):
        assert abs(np.cos(motion[2]) * motion[4] - np.sin(motion[2]) * motion[3]) < 2e-6


def test_equal_runs_are_equal_and_other_seeds_are_not() -> None:
    def measured(seed: int) -> Array:
        simulation = CartSimulation(table_one(5, seed=seed))
        return np.array([simulation.advance(push(k, (30.0, 0.0, 1.0))).measurements["p1"].motion for k in range(50)])

    np.testing.assert_array_equal(measured(3), measured(3))
    assert np.abs(measured(3) - measured(4)).max() > 0.005


def test_noise_is_as_large_as_the_scenario_says() -> None:
    simulation = CartSimulation(structs.replace(QUIET, noise=0.02, force_noise=3.0))
    found = [simulation.advance({}).measurements["p1"] for _ in range(2000)]
    np.testing.assert_allclose(np.std([m.motion for m in found], axis=0), 0.02, rtol=0.1)
    np.testing.assert_allclose(np.std([m.wrench for m in found], axis=0), [3.0, 3.0, 0.3], rtol=0.1)


def test_what_is_dropped_on_it_takes_momentum_and_what_is_taken_off_does_not() -> None:
    place = (0.5, 0.1)
    loads = (CartLoad(at=2.0, mass=8.0, place=place), CartLoad(at=3.0, mass=-8.0, place=place))
    simulation = CartSimulation(structs.replace(QUIET, loads=loads))
    before = None
    for k in range(302):
        sample = simulation.advance(push(k, (30.0, 0.0, 1.0)))
        motion = sample.truth.motion
        moving = np.array([np.hypot(motion[3], motion[4]), motion[5]])
        if k == 200:
            assert before is not None
            heavier = with_load(QUIET.cart, loads[0])
            assert sample.truth.cart.mass == 28.0

            def momentum(phi: Array, moving: Array) -> Array:
                m, _, b, j = phi
                return np.array([m * moving[0] - b * moving[1], j * moving[1] - b * moving[0]])

            np.testing.assert_allclose(momentum(heavier.phi, moving), momentum(QUIET.cart.phi, before), atol=0.5)
            assert moving[0] < 0.85 * before[0]
        if k == 300:
            assert before is not None
            assert sample.truth.cart.mass == pytest.approx(20.0)
            np.testing.assert_allclose(sample.truth.cart.com, QUIET.cart.com, atol=1e-12)
            np.testing.assert_allclose(moving, before, atol=0.02)
        before = moving


def test_a_crate_has_a_moment_of_inertia_of_its_own() -> None:
    point = CartLoad(at=1.0, mass=12.0, place=(0.5, 0.1))
    with_point, with_crate = (with_load(QUIET.cart, load) for load in (point, structs.replace(point, size=(0.9, 0.6))))
    assert with_crate.com == pytest.approx(with_point.com)
    assert with_crate.inertia - with_point.inertia == pytest.approx(12.0 * (0.81 + 0.36) / 12.0)


def test_turning_has_a_friction_of_its_own() -> None:
    """``I w' = -sigma w`` on the spot, about the middle of the axle."""
    cart = structs.replace(QUIET.cart, com=(0.0, 0.0), friction=(5.0, 2.0))
    simulation = CartSimulation(structs.replace(QUIET, cart=cart))
    simulation.data.qvel[2] = 1.0
    for _ in range(101):
        sample = simulation.advance({})
    assert sample.truth.motion[5] == pytest.approx(np.exp(-2.0 / cart.inertia), rel=1e-5)


@pytest.mark.parametrize("at", [0.0, 0.28, 0.29, 0.57, 0.575, 1.1, 1.13, 1.15])
def test_a_load_comes_with_the_first_sample_not_before_its_time(at: float) -> None:
    simulation = CartSimulation(structs.replace(QUIET, loads=(CartLoad(at=at, mass=8.0, place=(0.5, 0.1)),)))
    masses = [simulation.advance({}).truth.cart.mass for _ in range(120)]
    assert masses.index(28.0) == -(-round(1000 * at) // 10)


def test_friction_alone_stops_it() -> None:
    """``m v' = -sigma v`` straight ahead."""
    centred = structs.replace(QUIET, cart=structs.replace(QUIET.cart, com=(0.3, 0.0)))
    simulation = CartSimulation(centred)
    simulation.data.qvel[0] = 2.0
    for _ in range(401):
        sample = simulation.advance({})
    assert sample.truth.motion[3] == pytest.approx(2.0 * np.exp(-5.0 / 20.0 * 4.0), rel=1e-5)


def test_casters_drag_only_while_they_turn_round() -> None:
    casters = Casters()
    ahead = [casters.drag(0.5, 0.002) for _ in range(1000)]
    assert np.abs(ahead).max() == 0.0
    back = [casters.drag(-0.5, 0.002) for _ in range(1000)]
    assert max(back) > 10.0  # against the motion
    assert min(back) > -1e-12
    assert back[-1] == pytest.approx(0.0, abs=1e-12)


def test_a_cart_that_is_gone_is_told() -> None:
    simulation = CartSimulation(QUIET)
    simulation.data.qvel[0] = 1e5
    with pytest.raises(SimulationError, match="out of bounds"):
        simulation.advance({})


@pytest.mark.parametrize("rate", [50, 100, 500])
def test_as_much_time_passes_as_it_tells(rate: int) -> None:
    simulation = CartSimulation(structs.replace(QUIET, rate=rate))
    for _ in range(5):
        passed = simulation.data.time
        assert passed == pytest.approx(simulation.advance({}).truth.time)


@pytest.mark.parametrize("rate", [300, 1000, 0, -100])
def test_a_rate_at_which_the_physics_cannot_sample_is_refused(rate: int) -> None:
    with pytest.raises(ScenarioError, match=f"'test 5': key 'rate': found {rate}, expected one of 1, 2, .* 250, 500:"):
        structs.replace(QUIET, rate=rate)


def test_a_server_that_is_told_such_a_rate_says_so() -> None:
    config = msgspec.to_builtins(CartServerConfig(scenario=QUIET, run="run", robots={}, observe="tcp/127.0.0.1:0"))
    config["scenario"]["rate"] = 300
    told = msgspec.json.encode(config) + b"\n"
    done = subprocess.run([sys.executable, "-m", "coheft.physics_server.cart.server"], input=told, capture_output=True)
    assert done.returncode == 2
    assert b"key 'rate': found 300" in done.stderr
    assert b"Traceback" not in done.stderr
