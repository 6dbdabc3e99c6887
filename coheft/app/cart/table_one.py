"""The tests of Aguilera et al., Table I, with assumptions where the paper leaves values open."""

from coheft.estimation.cart.model import CartBody
from coheft.estimation.cart.prior import CartPrior
from coheft.wire.cart.scenario import CartLoad, CartScenario, TrajectoryName

MASS, INERTIA, FRICTION = 20.0, 2.0, 5.0
"""The cart in every test; the paper gives only the mass [kg, kg·m², N·s/m]."""
GUESSED_COM = (0.3, 0.0)

_Row = tuple[TrajectoryName, float, tuple[float, float], float, bool]
_ROWS: dict[int, _Row] = {
    1: ("straight", 16.0, (0.3, 0.0), 0.005, False),
    2: ("straight", 24.0, (0.3, 0.0), 0.005, False),
    3: ("straight", 16.0, (0.3, 0.15), 0.005, True),
    4: ("curves", 16.0, (0.3, 0.0), 0.005, False),
    5: ("curves", 16.0, (0.3, 0.15), 0.005, False),
    6: ("curves", 16.0, (0.3, -0.15), 0.005, True),
    7: ("curves", 16.0, (0.1, 0.0), 0.005, True),
    8: ("curves", 10.0, (0.3, 0.15), 0.005, False),
    9: ("curves", 16.0, (0.3, 0.15), 0.05, True),
    10: ("curves", 16.0, (0.3, 0.15), 0.2, True),
    11: ("curves", 16.0, (0.3, 0.0), 0.005, True),
}
"""Trajectory, first guess of the mass [kg], true centre of mass [m], noise, whether the hand slides."""

TESTS = tuple(_ROWS)
_LITTLE_NOISE = 0.005
_CHANGES = 11
"""Number of the test in which loads are added and removed."""
QUIET_TESTS = tuple(test for test, row in _ROWS.items() if row[3] <= _LITTLE_NOISE and test != _CHANGES)
"""Tests with little noise and a constant load."""
REVERSAL = 12
"""Number of a test that is not in Table I: push and pull, with casters that turn around and 3 N of force noise."""

MASS_CHANGES = (
    CartLoad(at=10.5, mass=5.0, place=(0.3, 0.0)),
    CartLoad(at=18.5, mass=5.0, place=(0.3, 0.0)),
    CartLoad(at=28.5, mass=-10.0, place=(0.3, 0.0)),
)
"""Loads of test 11, of which the paper gives neither times nor masses: added in curves, removed while braking."""


def table_one(
    number: int,
    *,
    seed: int = 1,
    learns: bool = True,
    pushers: int = 1,
    friction_guess: float | None = None,
    turning_friction: float = 1.0,
    noise_factor: float = 1.0,
) -> CartScenario:
    """Test 1 to 11 of Table I, or 12, which is modelled on the paper's hardware experiment 5.

    ``friction_guess`` is the pushers' guess of the translational friction, relative to the true one; None if they know
    it, as in the paper. They guess the same number for the turning friction, and estimate it. ``turning_friction`` is
    relative to the translational one [m²]; in the paper they are one number. ``noise_factor`` is that of
    ``CartScenario``.
    """
    row: _Row = ("there and back", 16.0, (0.3, 0.15), 0.005, False) if number == REVERSAL else _ROWS[number]
    trajectory, guessed_mass, com, noise, slides = row
    guessed_friction = FRICTION * (friction_guess or 1.0)
    return CartScenario(
        name=f"test {number}",
        cart=CartBody(mass=MASS, com=com, inertia=INERTIA, friction=(FRICTION, FRICTION * turning_friction)),
        # The guess of the moment of inertia is that of a box of 1 m by 0.6 m.
        guess=CartBody(
            mass=guessed_mass,
            com=GUESSED_COM,
            inertia=guessed_mass * (1.0 + 0.36) / 12.0,
            friction=(guessed_friction, guessed_friction),
        ),
        prior=CartPrior(friction=(0.0 if friction_guess is None else 1.0, 1.0)),
        trajectory=trajectory,
        noise=noise,
        noise_factor=noise_factor,
        force_noise=3.0 if number == REVERSAL else 0.0,
        casters=number == REVERSAL,
        slides=slides,
        learns=learns,
        loads=MASS_CHANGES if number == _CHANGES else (),
        seed=seed,
        pushers=pushers,
    )
