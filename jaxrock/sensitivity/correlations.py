"""Correlations of uncertain parameters: what is allowed, and the factor that makes them."""

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from ..validation import Number, as_real, check_kind, describe
from .parameters import refuse_name

# Two names, in the order in which the coefficients of variation have them.
Pair = tuple[str, str]

# Eigenvalues of a singular matrix and pivots of its factor are 0 to rounding.
_ROUNDING_OF_EIGENVALUES = 1e-12
_ROUNDING_OF_PIVOTS = 1e-14


def check_correlations(
    correlations: Mapping[Pair, Number], names: Sequence[str]
) -> tuple[tuple[Pair, float], ...]:
    """Check correlations, and list them in the order of the names.

    A correlation of 0 is left out: all pairs that are not listed are uncorrelated.

    Raises
    ------
    ValueError
        If a pair is not one of two different names, or there in both orders; if a correlation
        is not a number between -1 and 1; if no numbers are correlated like this.
    """
    check_kind("correlations", correlations, Mapping)
    coefficients = dict[Pair, float]()
    for key, value in correlations.items():
        if not isinstance(key, tuple) or len(set(key)) != 2:
            raise ValueError(
                f"correlations must have pairs of different names as keys, got {describe(key)}"
            )
        for name in key:
            if name not in names:
                refuse_name(name, names, "correlations")
        first, second = sorted(map(str, key), key=names.index)
        subject = f"correlations of {first} and {second}"
        coefficient = as_real(subject, value)
        if coefficient.ndim or not -1 <= coefficient <= 1:
            raise ValueError(
                f"{subject} must be a number between -1 and 1, got {describe(value)}"
            )
        if (first, second) in coefficients:
            raise ValueError(
                f"correlations must have each pair once, got {first} and {second}"
            )
        coefficients[first, second] = float(value)
    listed = sorted(
        ((pair, value) for pair, value in coefficients.items() if value),
        key=lambda entry: [names.index(name) for name in entry[0]],
    )
    matrix = _make_matrix(listed, names)
    smallest = np.linalg.eigvalsh(matrix).min() if listed else 1.0
    if smallest < -_ROUNDING_OF_EIGENVALUES:
        raise ValueError(
            "correlations must form a positive semi-definite matrix, got one with the"
            f" eigenvalue {smallest:.3g}: no variables have such correlations"
        )
    return tuple(listed)


def factor_correlations(
    correlations: Collection[tuple[Pair, float]], names: Sequence[str]
) -> np.ndarray:
    """Factor the matrix of correlations, which may be singular, by Cholesky's method.

    Parameters
    ----------
    correlations : tuple
        As `check_correlations` lists them.
    names : sequence of str

    Returns
    -------
    ndarray, shape (names, names)
        Lower triangular. Its product with independent standard normal numbers are standard
        normal numbers with these correlations; the row of a name that is correlated with none
        before it has a 1 on the diagonal and nothing else.
    """
    matrix = _make_matrix(correlations, names)
    factor = np.zeros_like(matrix)
    for k in range(len(names)):
        remainder = matrix[k:, k] - factor[k:, :k] @ factor[k, :k]
        # A number that those before it decide has no part of its own.
        if remainder[0] > _ROUNDING_OF_PIVOTS:
            factor[k:, k] = remainder / remainder[0] ** 0.5
    return factor


def _make_matrix(
    correlations: Collection[tuple[Pair, float]], names: Sequence[str]
) -> np.ndarray:
    """Make the symmetric matrix of correlations, shape (names, names)."""
    matrix = np.eye(len(names))
    for (first, second), coefficient in correlations:
        row = names.index(first)
        column = names.index(second)
        matrix[row, column] = coefficient
        matrix[column, row] = coefficient
    return matrix
