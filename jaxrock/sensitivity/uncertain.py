"""Uncertain parameters of blocks and their impacts, and samples of them."""

from collections.abc import Mapping
from typing import NamedTuple

import equinox as eqx
import numpy as np

from ..block import Block
from ..host import Printed, format_number
from ..impact import read_restitution
from ..validation import NON_NEGATIVE, Domain, Number, Numbers, as_real, check, check_kind
from .distributions import compute_quantiles, draw_normal_numbers
from .parameters import name_parameters

# Two names, in the order of the coefficients of variation.
Pair = tuple[str, str]

_CORRELATION = Domain("between -1 and 1", lambda x: abs(x) <= 1, 0.0)
# Eigenvalues of a singular matrix and pivots of its factor are 0 to rounding.
_ROUNDING_OF_EIGENVALUES = 1e-12
_ROUNDING_OF_PIVOTS = 1e-14
ARGUMENT = "coefficients_of_variation"  # argument of `Uncertain`, for messages
# Factors on the periods and dampings of all modes of a floor.
FLOOR_NAMES = ("floor_period", "floor_damping")


class FloorFactors(NamedTuple):
    """Factors on the periods and dampings of a floor, for each sample [-]."""

    period: np.ndarray
    damping: np.ndarray


class Draws(NamedTuple):
    """Samples of blocks and their restitutions; see `Uncertain.draw`.

    Attributes
    ----------
    block, restitution : Block of ndarray, ndarray, shape (..., samples)
    normal : ndarray, shape (samples, names)
        The standard normal variable from which each sample of each uncertain parameter
        follows, correlated as the parameters are. It is the same for all objects.
    floor : FloorFactors or None
        Of shape (..., samples); None where the floor is not uncertain.
    """

    block: Block
    restitution: np.ndarray
    normal: np.ndarray
    floor: FloorFactors | None = None


class Uncertain(Printed, eqx.Module):
    """Uncertain parameters, by coefficients of variation, and how they are sampled.

    Each parameter has a value without uncertainty, and a coefficient of variation. A
    ``restitution`` or ``damping_ratio`` has a Beta distribution, of which the value is the
    mean. All others are lognormal, negative ones by their magnitude, and the value is the median.
    They are independent except for the given correlations.

    Parameters
    ----------
    coefficients_of_variation : mapping
        Standard deviation over mean [-], finite and at least 0, by name; one number, or one
        for each object. Of a block the names are ``width`` (at this height) and ``height``
        (at this width), or ``half_width`` (at this slenderness) and ``slenderness``, or
        ``critical_angle`` and ``frequency_parameter``, which can be measured; ``gravity`` and
        ``inertia_ratio``. For the floor of a suite the names are ``floor_period`` and
        ``floor_damping``, which are common to all modes. Functions that take an `Uncertain`
        list any further names.
    correlations : mapping, optional
        Correlation coefficients [-], between -1 and 1, by pairs of names: of the standard
        normal variables from which the parameters follow, for lognormal parameters their
        logarithms. Pairs that are not given are uncorrelated. All objects have the same
        correlations.
    samples : int
        Number of samples, a power of 2.
    seed : int
        Seed of the scrambling of the Sobol points, at least 0.

    Attributes
    ----------
    names, coefficients, matrix : tuple
        The names; the coefficients in the same order, each a number, or a tuple of them; and
        the rows of the matrix of correlations.

    Raises
    ------
    ValueError
        If a coefficient is out of range; if `correlations` are not of two different names
        each, or form no positive semi-definite matrix; if `samples` is not as above.

    Notes
    -----
    Correlated parameters are a linear map of independent standard normal variables, by the
    Cholesky factor of the correlations. The first name keeps its own points, and so does
    every name that is correlated with none before it.

    Examples
    --------
    >>> import jaxrock as jr
    >>> print(jr.Uncertain({"width": 0.02, "restitution": 0.05}, samples=1024))
    coefficients of variation: width 0.02, restitution 0.05; 1024 samples, seed 0
    >>> coefficients = {"critical_angle": 0.1, "frequency_parameter": 0.05}
    >>> correlations = {("critical_angle", "frequency_parameter"): 0.4}
    >>> print(jr.Uncertain(coefficients, correlations=correlations))
    coefficients of variation: critical_angle 0.1, frequency_parameter 0.05; correlations:\
 critical_angle and frequency_parameter 0.4; 64 samples, seed 0
    """

    names: tuple[str, ...] = eqx.field(static=True)
    # Tuples of plain numbers: an `Uncertain` is immutable, and equals another of the same
    # values.
    coefficients: tuple[float | tuple[float, ...], ...] = eqx.field(static=True)
    matrix: tuple[tuple[float, ...], ...] = eqx.field(static=True)
    samples: int = eqx.field(static=True)
    seed: int = eqx.field(static=True)

    def __init__(
        self,
        coefficients_of_variation: Mapping[str, Numbers],
        *,
        correlations: Mapping[Pair, Number] | None = None,
        samples: int = 64,
        seed: int = 0,
    ):
        check_kind(ARGUMENT, coefficients_of_variation, Mapping)
        coefficients = []
        for name, value in coefficients_of_variation.items():
            subject = f"{ARGUMENT} of {name}"
            check(subject, as_real(subject, value), NON_NEGATIVE)
            # Values stay in float64 even if JAX computes in float32.
            numbers = np.asarray(value, float).tolist()
            coefficients.append(tuple(numbers) if isinstance(numbers, list) else numbers)
        # Only powers of 2 points are balanced, with errors of order 1 / n.
        if type(samples) is not int or samples < 1 or samples & (samples - 1):
            raise ValueError(f"samples must be a power of 2, got {samples!r:.60}")
        self.names = tuple(coefficients_of_variation)
        self.coefficients = tuple(coefficients)
        self.matrix = _arrange_correlations(correlations or {}, self.names)
        self.samples = samples
        self.seed = seed

    def __str__(self) -> str:
        numbers = self.coefficients_of_variation.items()
        coefficients = [f"{name} {format_number(value)}" for name, value in numbers]
        pairs = [
            f"{' and '.join(pair)} {value:g}" for pair, value in self.correlations.items()
        ]
        text = f"coefficients of variation: {', '.join(coefficients) or 'none'}; "
        text += f"correlations: {', '.join(pairs)}; " if pairs else ""
        return f"{text}{self.samples} samples, seed {self.seed}"

    @property
    def coefficients_of_variation(self) -> dict[str, np.ndarray]:
        """The coefficients by name, of shape () or (objects,) [-]."""
        return dict(zip(self.names, map(np.array, self.coefficients), strict=True))

    @property
    def correlations(self) -> dict[Pair, float]:
        """The correlation coefficients that are not 0, by pairs of names [-]."""
        pairs = zip(*np.triu_indices(len(self.names), 1), strict=True)
        named = {(self.names[k], self.names[j]): self.matrix[k][j] for k, j in pairs}
        return {pair: value for pair, value in named.items() if value}

    @property
    def factor(self) -> np.ndarray:
        """Cholesky factor of the correlations, which may be singular; shape (names, names)."""
        matrix = np.array(self.matrix).reshape(len(self.names), -1)
        factor = np.zeros_like(matrix)
        for k in range(len(matrix)):
            remainder = matrix[k:, k] - factor[k:, :k] @ factor[k, :k]
            # A variable that the ones before it determine has no independent part.
            if remainder[0] > _ROUNDING_OF_PIVOTS:
                factor[k:, k] = remainder / remainder[0] ** 0.5
        return factor

    def draw(self, block: Block, restitution: Number, *, on_floor: bool = False) -> Draws:
        """Draw samples of a block, or of each of many, by scrambled Sobol points.

        All objects share the points, so that a difference between two objects is not sampling
        noise. The samples of an object do not depend on the other objects.

        Parameters
        ----------
        block, restitution : Block, array_like, shape (...)
            Without uncertainty.
        on_floor : bool
            Whether there is a floor, whose period and damping may be uncertain.

        Returns
        -------
        Draws
            In NumPy and float64.

        Raises
        ------
        ValueError
            If a name is no parameter, or names a floor although there is none; if
            descriptions of a size are mixed; if coefficients are not one for each object; if
            an inertia ratio falls below 1, or a critical angle reaches pi / 2; if the
            coefficient of variation of a restitution is above 0 at a mean of 1, or so large
            that the density has two peaks.

        Examples
        --------
        >>> import jaxrock as jr
        >>> uncertain = jr.Uncertain({"restitution": 0.05}, samples=4)
        >>> draws = uncertain.draw(jr.Block(0.4, 5.0), 0.8)
        >>> print(draws.restitution.round(3))
        [0.793 0.829 0.808 0.759]
        """
        check_kind("block", block, Block)
        floor_names = [name for name in self.names if name in FLOOR_NAMES]
        if floor_names and not on_floor:
            raise ValueError(
                f"{ARGUMENT} has {floor_names[0]!r}, but the suite is on no floor whose period and"
                " damping are known; Suite.on_floor puts it on one"
            )
        arguments = {"block": block, "restitution": read_restitution(block, restitution)}
        arguments |= dict.fromkeys(FLOOR_NAMES if floor_names else (), 1.0)
        parameters = name_parameters(arguments, self.names, ARGUMENT)
        shape = np.broadcast_shapes(*map(np.shape, parameters.values.values()))
        independent = draw_normal_numbers(len(self.names), self.samples, self.seed)
        normal = independent @ self.factor.T
        full = (*shape, self.samples)
        samples = {
            name: np.broadcast_to(np.expand_dims(value, -1), full)
            for name, value in parameters.values.items()
        }
        for k, (name, variation) in enumerate(self.coefficients_of_variation.items()):
            if np.shape(variation) not in ((), shape):
                raise ValueError(
                    f"{ARGUMENT} of {name} must be one number, or one for each object, got"
                    f" {np.size(variation)} for objects of shape {shape}"
                )
            samples[name] = compute_quantiles(
                name, normal[:, k], samples[name], np.expand_dims(variation, -1)
            )
        drawn = parameters.build(samples)
        floor = FloorFactors(*(drawn[name] for name in FLOOR_NAMES)) if floor_names else None
        return Draws(drawn["block"], drawn["restitution"], normal, floor)


def list_single_coefficients(uncertain: Uncertain) -> np.ndarray:
    """List the coefficients of variation; a `ValueError` if one is an array."""
    check_kind("uncertain", uncertain, Uncertain)
    if any(map(np.ndim, uncertain.coefficients)):
        raise ValueError(f"{ARGUMENT} must be one number for each name here, got {uncertain}")
    return np.array(uncertain.coefficients)


def _arrange_correlations(
    correlations: Mapping[Pair, Number], names: tuple[str, ...]
) -> tuple[tuple[float, ...], ...]:
    """Arrange correlations as the rows of a symmetric matrix.

    Raises
    ------
    ValueError
        If a pair does not consist of two different names; if a correlation is not a number
        between -1 and 1; if the matrix is not positive semi-definite.
    """
    matrix = np.eye(len(names))
    for pair, value in correlations.items():
        if len(pair) != 2 or len({*pair} & {*names}) != 2:
            raise ValueError(
                f"correlations must have pairs of different names among {', '.join(names)} as"
                f" keys, got {pair!r:.60}"
            )
        subject = f"correlations of {' and '.join(pair)}"
        check(subject, as_real(subject, value), _CORRELATION)
        row, column = map(names.index, pair)
        matrix[row, column] = matrix[column, row] = np.asarray(value, float)
    smallest = np.linalg.eigvalsh(matrix).min(initial=1.0)
    if smallest < -_ROUNDING_OF_EIGENVALUES:
        raise ValueError(
            "correlations must form a positive semi-definite matrix, got one with the"
            f" eigenvalue {smallest:.3g}: no variables have such correlations"
        )
    return tuple(map(tuple, matrix.tolist()))
