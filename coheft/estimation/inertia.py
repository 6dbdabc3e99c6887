"""Inertia from motions and wrenches: one linear model, accumulated so that it can be weighted later.

Barycentric model, unknown ``theta = (m, m h, I_o)`` about the origin of ``F_i`` (Atkeson, An, Hollerbach 1986):

    F = m a + ([alpha]x + [w]x^2) (m h),    T = I_o alpha + w x I_o w + (m h) x a

and, if asked for, a constant offset ``(F_0, T_0)`` of the total wrench, the sum of what all force-torque sensors read
in excess. Residuals are linear in ``FEATURES`` = 19 numbers per sample: 1, ``a``, ``alpha``, six products of ``w``,
``F``, ``T``. So the 190 different entries of their Gram matrix hold all that the samples say about ``theta``, under any
weights: samples are accumulated as packed Gram matrices, which add up, and turned into information when it is asked
for, in one product.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt

from coheft.estimation.body_motion import BODY_A, BODY_ALPHA, BODY_W
from coheft.estimation.rigid_body import (
    PACKED_COLUMNS,
    PACKED_ROWS,
    inertia_operator,
    pack_symmetric,
    unpack_symmetric,
)
from coheft.estimation.spatial import Array, skew

FEATURES = 19
WRENCH_FEATURES = slice(13, 19)
"""Where the total wrench stands among them."""
GRAM_SIZE = FEATURES * (FEATURES + 1) // 2
INERTIA_SIZE = 10
OFFSET_SIZE = 6
OFFSETS = slice(INERTIA_SIZE, INERTIA_SIZE + OFFSET_SIZE)
"""Among the unknowns, where offsets are among them."""
_ONE, _A, _ALPHA, _PRODUCTS = 0, slice(1, 4), slice(4, 7), slice(7, 13)
_ACCELERATIONS = slice(_A.start, _ALPHA.stop)
_ROWS, _COLUMNS = np.triu_indices(FEATURES)
_IDENTITY = np.eye(6)


@lru_cache
def _unpacking(size: int) -> npt.NDArray[np.intp]:
    """Where the entries of a symmetric matrix are in its packed upper triangle, shape (size, size); read only."""
    places = np.empty((size, size), dtype=np.intp)
    rows, columns = np.triu_indices(size)
    places[rows, columns] = places[columns, rows] = np.arange(len(rows))
    places.flags.writeable = False
    return places


_PLACES, _UPPER = _unpacking(FEATURES), _ROWS * FEATURES + _COLUMNS


def symmetric_products(w: Array) -> Array:
    """``w w^T`` packed as ``(xx, yy, zz, xy, xz, yz)``, shape (n, 3) to (n, 6)."""
    return w.take(PACKED_ROWS, axis=1) * w.take(PACKED_COLUMNS, axis=1)


def _products_regressor() -> Array:
    """Shape (6, 6, 10): ``symmetric_products(w)[k] * result[k]`` add up to the regressor's part that ``w`` makes."""
    regressor = np.zeros((6, 6, INERTIA_SIZE))
    for k, product in enumerate(unpack_symmetric(np.eye(6))):
        regressor[k, :3, 1:4] = product - np.trace(product) * np.eye(3)
        # w x I w is the axial vector of I w w^T.
        turned = unpack_symmetric(np.eye(6)) @ product
        regressor[k, 3:, 4:] = [
            turned[:, 2, 1] - turned[:, 1, 2],
            turned[:, 0, 2] - turned[:, 2, 0],
            turned[:, 1, 0] - turned[:, 0, 1],
        ]
    return regressor


_OF_PRODUCTS = _products_regressor()


def features(motion: Array, wrench: Array) -> Array:
    """Features of samples, shape (n, 19).

    Args:
        motion: Body motion ``(w, v, a, alpha)`` at ``F_i``, shape (n, 12).
        wrench: Total wrench ``(F, T)`` about the origin of ``F_i``, shape (n, 6).
    """
    result = np.empty((len(motion), FEATURES))
    result[:, _ONE] = 1.0
    result[:, _ACCELERATIONS] = motion[:, BODY_A.start : BODY_ALPHA.stop]
    result[:, _PRODUCTS] = symmetric_products(motion[:, BODY_W])
    result[:, WRENCH_FEATURES] = wrench
    return result


def packed_gram(sample_features: Array) -> Array:
    """Upper triangle of the Gram matrix of features (n, 19), shape (190,). The first entry counts the samples."""
    return repacked_gram(sample_features.T @ sample_features)


def unpacked_gram(packed: Array) -> Array:
    """Gram matrices (..., 19, 19) of packed ones (..., 190)."""
    gram: Array = packed.take(_PLACES, axis=-1)
    return gram


def repacked_gram(gram: Array) -> Array:
    """Inverse of ``unpacked_gram``."""
    packed: Array = gram.reshape(*gram.shape[:-2], FEATURES**2).take(_UPPER, axis=-1)
    return packed


@dataclass(frozen=True, eq=False)
class InertiaInformation:
    """What some samples say about the unknowns: ``matrix @ unknowns = vector``, noise of the regressor compensated.

    All may carry leading dimensions: one information for each of many windows.

    Attributes:
        matrix: Shape (..., u, u), u = 10, or 16 with the offset ``(F_0, T_0)``.
        vector: Shape (..., u).
        square: Weighted sum of the squared wrenches, shape (...).
        count: Number of samples, shape (...).
        uncompensated: ``matrix`` with what the noise of ``(a, alpha)`` adds to it, shape (..., u, u).
        score_covariance: Covariance of ``vector - matrix @ unknowns`` at the true unknowns, shape (..., u, u). For
            samples of equal weight it is ``uncompensated``, up to a part that is small wherever the motion is larger
            than its noise: noise in the regressor adds scatter although its bias is taken away.
    """

    matrix: Array
    vector: Array
    square: Array
    count: Array
    uncompensated: Array
    score_covariance: Array

    def mean_square(self, unknowns: Array) -> float:
        """Mean weighted square of the residuals: 1 up to sampling if model, noise and unknowns are right.

        Only for what ``InertiaModel.information`` gave: a prior that was added has no residuals.
        """
        explained = 2.0 * self.vector @ unknowns - unknowns @ self.uncompensated @ unknowns
        return float((self.square - explained) / (6.0 * self.count))


class InertiaModel:
    """Weights of the samples, and so the map from packed Gram matrices to information.

    Residuals ``r = (F, T) - regressor @ theta`` are weighted with the inverse of ``Sigma_r = Sigma_wrench + M Sigma_a
    M^T``, where ``M`` is the spatial inertia: noise of ``(a, alpha)`` enters as the wrench it would take. Noise of
    ``w`` is left out, it is far smaller.

    Args:
        wrench_covariance: Of the total wrench of one sample, lever arms included, shape (6, 6).
        acceleration_covariance: Of ``(a, alpha)`` of one sample, shape (6, 6).
        parameters: The best known ``theta``, shape (10,); weights hardly depend on it. None: nothing known yet.
        with_offset: Whether the constant offset is among the unknowns.

    Attributes:
        unknowns: ``u``, 10 or 16.
        residual_covariance: ``Sigma_r``, shape (6, 6).
        weight: Its inverse.
        regressor_coefficients: Shape (19, 6, u): features times these add up to the regressor.
        noise: What noise of a sample's ``(a, alpha)`` adds to ``regressor^T weight regressor``, shape (u, u).
        disturbance_size: As of ``expect_disturbance``.
    """

    def __init__(
        self,
        wrench_covariance: Array,
        acceleration_covariance: Array,
        parameters: Array | None = None,
        with_offset: bool = False,
    ) -> None:
        self._wrench_covariance, self._acceleration_covariance = wrench_covariance, acceleration_covariance
        self._parameters, self._shape = parameters, np.zeros((6, 6))
        self.disturbance_size = 0.0
        self._sibling: InertiaModel | None = None
        self.unknowns = INERTIA_SIZE + (OFFSET_SIZE if with_offset else 0)
        covariance = wrench_covariance
        if parameters is not None:
            spatial = spatial_inertia(parameters)
            covariance = wrench_covariance + spatial @ acceleration_covariance @ spatial.T
        self.residual_covariance = covariance
        self.weight: Array = np.linalg.inv(covariance).astype(np.float64)
        self._coefficients = coefficients = regressor_coefficients(with_offset)
        self.regressor_coefficients = coefficients[:, :, :-1]
        noise = _noise(coefficients, self.weight, acceleration_covariance)
        self._table = _packed_table(coefficients, self.weight)
        self._table[0] -= noise[np.triu_indices(len(noise))]
        self._unpack = _unpacking(len(noise))
        self.noise: Array = noise[:-1, :-1]
        self._disturbance_table = np.zeros_like(self._table)

    @cached_property
    def weighted_regressor(self) -> Array:
        """``regressor^T weight``, linear in the features as well, shape (19, u, 6)."""
        result: Array = self.regressor_coefficients.swapaxes(1, 2) @ self.weight
        return result

    def with_offset(self) -> InertiaModel:
        """The same weights, with the constant offset among the unknowns."""
        if self._sibling is None:
            self._sibling = InertiaModel(
                self._wrench_covariance, self._acceleration_covariance, self._parameters, with_offset=True
            )
            self._sibling.expect_disturbance(self._shape, self.disturbance_size)
        return self._sibling

    def information(self, grams: Array) -> InertiaInformation:
        """Information of packed Gram matrices, shape (..., 190)."""
        joint = (grams @ self._table).take(self._unpack, axis=-1)
        matrix, count = joint[..., :-1, :-1], grams[..., 0]
        uncompensated = matrix + count[..., None, None] * self.noise
        return InertiaInformation(
            matrix=matrix,
            vector=joint[..., :-1, -1],
            square=joint[..., -1, -1],
            count=count,
            uncompensated=uncompensated,
            score_covariance=uncompensated,
        )

    def expect_disturbance(self, shape: Array, size: float = 0.0) -> None:
        """Beside noise, something spoils the total wrench.

        Args:
            shape: Its covariance (6, 6), up to its size.
            size: Of what spoils all samples; what spoils some of them besides is told with them.
        """
        self._shape, self.disturbance_size, self._sibling = shape, size, None
        self._disturbance_table = _packed_table(self._coefficients, self.weight @ shape @ self.weight)

    def disturbance(self, grams: Array) -> Array:
        """What the disturbance adds to the score's covariance, if it is new with every sample, shape (..., u, u)."""
        result: Array = (grams @ self._disturbance_table).take(self._unpack[:-1, :-1], axis=-1)
        return result


def _noise(coefficients: Array, weight: Array, acceleration_covariance: Array) -> Array:
    """What noise of ``(a, alpha)`` (6, 6) adds to a sample's ``[X | y]^T weight [X | y]``, as that is expected."""
    of_accelerations = coefficients[_ACCELERATIONS]
    spread = np.tensordot(acceleration_covariance, of_accelerations, axes=1)
    result: Array = np.einsum("kai,kaj->ij", of_accelerations, weight @ spread)
    return result


def _packed_table(coefficients: Array, weight: Array) -> Array:
    """From packed Gram matrices (190,) of features to the upper triangle of ``[X | y]^T weight [X | y]``."""
    features, _, size = coefficients.shape
    flat = coefficients.transpose(1, 0, 2).reshape(6, features * size)
    # Entry [k, i, l, j]: what the product of features k and l adds to entry (i, j).
    products = (flat.T @ weight @ flat).ravel()
    one, other, diagonal = _table_places(size)
    table = products.take(one)
    table += products.take(other)
    table[diagonal] *= 0.5
    return table


@lru_cache
def _table_places(size: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Where a table's entries are among the products of features (k, l), and of (l, k); and which rows have k = l."""
    rows, columns = np.triu_indices(size)

    def places(first: npt.NDArray[np.intp], second: npt.NDArray[np.intp]) -> npt.NDArray[np.intp]:
        return (first[:, None] * size + rows) * FEATURES * size + second[:, None] * size + columns

    return places(_ROWS, _COLUMNS), places(_COLUMNS, _ROWS), np.flatnonzero(_ROWS == _COLUMNS)


def spatial_inertia(parameters: Array) -> Array:
    """``M`` (6, 6) with ``(F, T) = M (a, alpha)`` of a body with ``theta`` (10,) that does not turn yet."""
    spatial: Array = parameters[0] * _IDENTITY
    spatial[3:, :3] = moment = skew(parameters[1:4])
    spatial[:3, 3:] = -moment
    spatial[3:, 3:] = unpack_symmetric(parameters[4:10])
    return spatial


def products_wrench(spatial: Array) -> Array:
    """Shape (6, 6): ``symmetric_products(w) @ result`` is the wrench that turning with ``w`` takes.

    Args:
        spatial: ``M`` of ``spatial_inertia``, shape (6, 6).
    """
    moment = np.array([spatial[5, 1], spatial[3, 2], spatial[4, 0]])
    parameters = np.concatenate([[spatial[0, 0]], moment, pack_symmetric(spatial[3:, 3:])])
    result: Array = _OF_PRODUCTS @ parameters
    return result


@lru_cache
def regressor_coefficients(with_offset: bool) -> Array:
    """Shape (19, 6, u + 1): features times these add up to ``[regressor | wrench]``; read only."""
    size = INERTIA_SIZE + (OFFSET_SIZE if with_offset else 0) + 1
    result = np.zeros((FEATURES, 6, size))
    axes = np.eye(3)
    result[_A, :3, 0] = axes
    result[_A, 3:, 1:4] = -skew(axes)
    result[_ALPHA, :3, 1:4] = skew(axes)
    result[_ALPHA, 3:, 4:10] = inertia_operator(axes)
    result[_PRODUCTS, :, :INERTIA_SIZE] = _OF_PRODUCTS
    result[WRENCH_FEATURES, :, -1] = np.eye(6)
    if with_offset:
        result[_ONE, :, INERTIA_SIZE:-1] = np.eye(6)
    result.flags.writeable = False
    return result
