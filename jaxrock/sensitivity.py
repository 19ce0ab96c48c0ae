"""What an answer depends on: slopes, elasticities, swings, and scatter carried through.

Everything here takes an *answer*, a function of one pytree of numbers (a `Scene`, a `Block`,
a dict) with one number as its value, and the pytree at which to ask: closed-form, pulsed or
driven by a record.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .distributions import Distributions
from .printing import listed, table

Answer = Callable[[Any], Any]

_TOGETHER = 2**14  # samples computed at once
_ALLOWED = 0.1  # errors of mean and standard deviation, over the standard deviation


class Sensitivities(NamedTuple):
    """An answer's derivatives to every number it depends on; see `sensitivities`.

    Attributes
    ----------
    names : tuple of str
        Of the numbers.
    at : ndarray, shape (numbers,)
        Where the derivatives are taken, each in its unit.
    value : float
        The answer there, in the unit of the answer.
    gradient : ndarray, shape (numbers,)
        Slope to each number.
    elasticity : ndarray, shape (numbers,)
        Relative change of the answer over that of the number, ``(x / y) dy / dx``.
    hessian : ndarray, shape (numbers, numbers)
        Second derivatives.
    """

    names: tuple[str, ...]
    at: np.ndarray
    value: float
    gradient: np.ndarray
    elasticity: np.ndarray
    hessian: np.ndarray

    def __str__(self) -> str:
        columns = {"at": self.at, "slope": self.gradient, "elasticity": self.elasticity}
        return table(f"{self.value:.6g}", self.names, **columns)


class Swing(NamedTuple):
    """What each number can do to an answer within its range; see `tornado`.

    Attributes
    ----------
    names : tuple of str
        Of the numbers, the one with the widest swing first.
    low, high : ndarray, shape (numbers,)
        The range of each.
    at_low, at_high : ndarray, shape (numbers,)
        The answer there, all others as they are.
    value : float
        The answer where none has been changed.
    """

    names: tuple[str, ...]
    low: np.ndarray
    high: np.ndarray
    at_low: np.ndarray
    at_high: np.ndarray
    value: float

    def __str__(self) -> str:
        columns = {name: getattr(self, name) for name in ("low", "high", "at_low", "at_high")}
        return table(f"{self.value:.6g}", self.names, **columns)


class Scatter(NamedTuple):
    """Mean and standard deviation of an answer; see `propagate`.

    Attributes
    ----------
    mean_first, deviation_first : float
        To first order in the scatter.
    mean, deviation : float
        To second order.
    shares : dict
        Of the variance to first order, by number.
    holds : bool
        Whether `mean` is right to a tenth of the deviation and `deviation` to 10 %, as far as
        samples show, and all of them have an answer: not so where it bends too much within
        the scatter, is chaotic, or ceases to exist because the block overturns.
    mean_error, deviation_error : float
        What the samples say that `mean` and `deviation` are off by, with twice the noise of
        that, over the deviation; inf where a sample has no answer.
    left_out : float
        Share of samples without an answer.
    """

    mean_first: float
    deviation_first: float
    mean: float
    deviation: float
    shares: dict[str, float]
    holds: bool
    mean_error: float
    deviation_error: float
    left_out: float

    def __str__(self) -> str:
        return listed(self, **dict.fromkeys(self._fields, ""))


class Probability(NamedTuple):
    """Probability that a margin is negative; see `failure_probability`.

    Attributes
    ----------
    probability : float
        From the verge as a parabola at its most likely point.
    probability_first : float
        From the verge as a plane there.
    reliability_index : float
        beta, the distance of that point from the median, in standard deviations; negative
        where the median itself is beyond the verge.
    most_likely : dict
        The numbers at that point.
    misjudged : float
        Share of samples that the parabola puts on the wrong side of the verge, no less than
        the error of `probability`, but for the noise of sampling.
    holds : bool
        Whether the search came to an end, and the samples do not contradict.
    """

    probability: float
    probability_first: float
    reliability_index: float
    most_likely: dict[str, float]
    misjudged: float
    holds: bool

    def __str__(self) -> str:
        return listed(self, **dict.fromkeys(self._fields, ""))


class GlobalSensitivities(NamedTuple):
    """Derivative-based measures over ranges; see `global_sensitivities`.

    Attributes
    ----------
    names : tuple of str
        Of the numbers.
    mean_slope : ndarray, shape (numbers,)
        Mean magnitude of the slope to each.
    measure : ndarray, shape (numbers,)
        nu, the mean square of the slope.
    bound : ndarray, shape (numbers,)
        nu (high - low)^2 / (pi^2 variance): no less than Sobol's total index.
    mean, deviation : float
        Of the answer over the ranges.
    left_out : float
        Share of samples without an answer, which are not counted.
    """

    names: tuple[str, ...]
    mean_slope: np.ndarray
    measure: np.ndarray
    bound: np.ndarray
    mean: float
    deviation: float
    left_out: float

    def __str__(self) -> str:
        first = f"{self.mean:.6g} +- {self.deviation:.6g}, left out {self.left_out:.3g}"
        columns = {name: getattr(self, name) for name in ("mean_slope", "measure", "bound")}
        return table(first, self.names, **columns)


class _Numbers(NamedTuple):
    """A pytree as a list of named numbers."""

    names: tuple[str, ...]
    values: Any  # (numbers,)
    form: Any  # of the pytree

    @classmethod
    def of(cls, at: Any) -> "_Numbers":
        leaves = jax.tree.leaves_with_path(at)
        if not leaves:
            raise ValueError("at must contain at least one number")
        for path, leaf in leaves:
            if jnp.ndim(leaf):
                name = jax.tree_util.keystr(path)
                raise ValueError(f"at must consist of single numbers, got an array in {name}")
        at = jax.tree.map(lambda leaf: jnp.asarray(leaf, float), at)
        values, form = jnp.stack(jax.tree.leaves(at)), jax.tree.structure(at)
        keys = [[_key(part) for part in path] for path, _ in leaves]
        last = [key[-1] if key else "value" for key in keys]
        names = [
            short if last.count(short) == 1 else ".".join(key)
            for short, key in zip(last, keys, strict=True)
        ]
        return cls(tuple(names), values, form)

    def chosen(self, what: str, given: Mapping[str, Any]) -> list[int]:
        """Places of the names in a mapping."""
        for name in given:
            if name not in self.names:
                raise ValueError(f"{what} has {name!r}, which is none of {', '.join(self.names)}")
        return [self.names.index(name) for name in given]

    def asked(self, answer: Answer, places: Any = None, drawn: Any = None) -> "_Asked":
        """The answer as a function of the numbers at some places, or of what they are drawn by."""
        places = range(len(self.names)) if places is None else places
        drawn = None if drawn is None else jax.tree.map(jnp.asarray, drawn)
        return _Asked(answer, self.values, self.form, tuple(map(int, places)), drawn)


class _Asked(eqx.Module):
    """An answer as a function of some of its numbers, which is compiled once.

    What it is called with may be independent standard normal numbers, if the numbers are
    `drawn` by them.
    """

    answer: Answer
    values: Any  # (numbers,)
    form: Any = eqx.field(static=True)
    places: tuple[int, ...] = eqx.field(static=True)
    drawn: Distributions | None

    def numbers(self, some: Any) -> Any:
        """All numbers, as a list."""
        if self.drawn is not None:
            some = self.drawn.at(some)
        return self.values.at[np.asarray(self.places, int)].set(some)

    def __call__(self, some: Any) -> Any:
        value = jnp.asarray(self.answer(jax.tree.unflatten(self.form, list(self.numbers(some)))))
        if value.ndim:
            raise ValueError(f"answer must be one number, got an array of shape {value.shape}")
        return value


@eqx.filter_jit
def _value(asked: _Asked, some: Any) -> Any:
    return asked(some)


@eqx.filter_jit
def _slope(asked: _Asked, some: Any) -> Any:
    return jax.jacfwd(asked)(some)


@eqx.filter_jit
def _expanded(asked: _Asked, some: Any) -> tuple[Any, Any, Any]:
    """Value, slopes and second derivatives."""
    slope = jax.jacfwd(asked)
    return asked(some), slope(some), jax.jacfwd(slope)(some)


@eqx.filter_jit
def _values(asked: _Asked, points: Any) -> Any:
    return jax.vmap(asked)(points)


@eqx.filter_jit
def _slopes_and_values(asked: _Asked, points: Any) -> Any:
    return jax.vmap(lambda some: jnp.append(jax.jacfwd(asked)(some), asked(some)))(points)


def _key(part: Any) -> str:
    return str(getattr(part, "name", getattr(part, "key", getattr(part, "idx", part))))


def sensitivities(answer: Answer, at: Any) -> Sensitivities:
    """Value, slopes, elasticities and second derivatives of an answer.

    Parameters
    ----------
    answer : callable
        From a pytree of numbers to one number.
    at : pytree
        Where to ask.

    Returns
    -------
    Sensitivities

    Raises
    ------
    ValueError
        If `at` is not made of single numbers, or `answer` not one.

    Examples
    --------
    >>> import jaxrock as jr
    >>> wall = jr.Scene(jr.Block(0.4, 5.0), restitution=0.7, intensity=0.15)
    >>> print(jr.sensitivities(jr.rotation_ratio, wall))
    0.123215
                                    at         slope    elasticity
    half_width                     0.4     -0.329681      -1.07027
    slenderness                      5     0.0280581       1.13859
    gravity                       9.81    -0.0134427      -1.07027
    restitution                    0.7       0.87915       4.99457
    intensity                     0.15        1.7583       2.14053
    """
    numbers = _Numbers.of(at)
    value, slope, curvature = _expanded(numbers.asked(answer), numbers.values)
    with np.errstate(divide="ignore", invalid="ignore"):
        elasticity = np.asarray(slope) * np.asarray(numbers.values) / np.asarray(value)
    return Sensitivities(
        numbers.names,
        np.asarray(numbers.values),
        float(value),
        np.asarray(slope),
        elasticity,
        np.asarray(curvature),
    )


def tornado(answer: Answer, at: Any, ranges: Mapping[str, tuple[float, float]]) -> Swing:
    """What each number can do to an answer within its range, the others left as they are.

    Parameters
    ----------
    answer : callable
        From a pytree of numbers to one number.
    at : pytree
        Where to ask.
    ranges : dict
        Low and high value by name, for the numbers to change.

    Returns
    -------
    Swing
        Sorted, the widest first.

    Raises
    ------
    ValueError
        If a name is not one of `at`.

    Examples
    --------
    >>> import jaxrock as jr
    >>> wall = jr.Scene(jr.Block(0.4, 5.0), restitution=0.7, intensity=0.15)
    >>> ranges = {"slenderness": (4.0, 6.0), "restitution": (0.6, 0.8)}
    >>> print(jr.tornado(jr.rotation_ratio, wall, ranges))
    0.123215
                                   low          high        at low       at high
    restitution                    0.6           0.8     0.0673033      0.307402
    slenderness                      4             6     0.0954255       0.15161
    """
    numbers = _Numbers.of(at)
    places = numbers.chosen("ranges", ranges)
    ends = np.asarray([ranges[name] for name in ranges], float).reshape(-1, 2)
    points = np.repeat(np.asarray(numbers.values)[None], 1 + ends.size, axis=0)
    for row, place in enumerate(places):
        points[1 + 2 * row : 3 + 2 * row, place] = ends[row]
    values = _sampled(_values, numbers.asked(answer), points)
    pairs = values[1:].reshape(-1, 2)
    width = np.nan_to_num(abs(pairs[:, 1] - pairs[:, 0]), nan=np.inf)
    order = np.argsort(-width, kind="stable")
    names = tuple(list(ranges)[k] for k in order)
    (low, high), (at_low, at_high) = ends[order].T, pairs[order].T
    return Swing(names, low, high, at_low, at_high, float(values[0]))


def propagate(
    answer: Answer,
    at: Any,
    variation: Mapping[str, float],
    samples: int = 1000,
    seed: int = 0,
) -> Scatter:
    """Mean and standard deviation of an answer under scatter, to first and second order.

    Samples then show whether the answer is like that. Only what it differs by from its
    second order is sampled, so that a thousand are enough.

    Parameters
    ----------
    answer : callable
        From a pytree of numbers to one number.
    at : pytree
        Medians.
    variation : dict
        Coefficient of variation (standard deviation over mean) by name; what is not named
        does not scatter. Numbers scatter independently: positive ones lognormally, a
        ``restitution`` or ``damping_ratio`` so that its logit is normal, all others normally.
    samples : int
        How many answers to compare with.
    seed : int
        Of the random numbers.

    Returns
    -------
    Scatter
        `holds` is False where the orders are not to be trusted.

    Raises
    ------
    ValueError
        If a name is not one of `at`, or a coefficient is negative, or a restitution cannot
        scatter so much: at 1, or so that it would have two peaks, near 0 and near 1.

    Examples
    --------
    >>> import jaxrock as jr
    >>> wall = jr.Scene(jr.Block(0.4, 5.0), restitution=0.7, intensity=0.15)
    >>> scatter = jr.propagate(jr.rotation_ratio, wall, {"intensity": 0.1, "restitution": 0.05})
    >>> print(f"{scatter.mean:.4f} +- {scatter.deviation:.4f}")
    0.1311 +- 0.0419
    """
    asked, _, _ = _scattering(answer, at, variation)
    drawn = np.random.default_rng(seed).standard_normal((samples, len(variation)))
    value, slope, curvature = map(np.asarray, _expanded(asked, jnp.zeros(len(variation))))
    found = _sampled(_values, asked, drawn)
    return _compared(tuple(variation), value, slope, curvature, drawn, found)


def _compared(
    names: tuple[str, ...],
    value: Any,
    slope: np.ndarray,
    curvature: np.ndarray,
    drawn: np.ndarray,
    found: np.ndarray,
) -> Scatter:
    """Moments of a quadratic in standard normal numbers, and how samples differ from them."""
    variance = float((slope**2).sum())
    second = variance + 0.5 * float((curvature**2).sum())
    mean, deviation = float(value + 0.5 * np.trace(curvature)), second**0.5
    known = np.isfinite(found)
    errors = (np.inf, np.inf)
    if known.all() and np.isfinite(mean + second):
        bent = 0.5 * np.einsum("ni,ij,nj->n", drawn, curvature, drawn)
        expected = value + drawn @ slope + bent
        errors = _moment_errors(expected, found - expected, mean, deviation)
    shares = slope**2 / (variance if variance else 1.0)
    return Scatter(
        float(value),
        variance**0.5,
        mean,
        deviation,
        dict(zip(names, shares.tolist(), strict=True)),
        max(errors) <= _ALLOWED,
        *errors,
        float(1 - known.mean()),
    )


def _moment_errors(
    expected: np.ndarray, rest: np.ndarray, mean: float, deviation: float
) -> tuple[float, float]:
    """What mean and deviation are off by because of the rest, with twice the noise of that."""
    noise = 2 / len(rest) ** 0.5
    rounding = 64 * float(np.finfo(rest.dtype).eps) * abs(mean)
    # The variance of the answer is that of what is expected and the mean of this.
    added = (2 * (expected - mean) + rest) * rest - rest.mean() ** 2
    spread = max(deviation**2 + float(added.mean()), 0.0) ** 0.5
    of_mean = float(abs(rest.mean()) + noise * rest.std())
    of_deviation = abs(spread - deviation)
    of_deviation += float(noise * added.std() / (spread + deviation or 1.0))
    if deviation == 0:
        least = 0.0 if max(of_mean, of_deviation) <= rounding else np.inf
        return least, least
    return of_mean / deviation, of_deviation / deviation


def monte_carlo(
    answer: Answer,
    at: Any,
    variation: Mapping[str, float],
    samples: int = 10_000,
    seed: int = 0,
) -> np.ndarray:
    """Answers for random samples of what scatters, as `propagate` has it scatter.

    Parameters
    ----------
    answer, at, variation
        As in `propagate`.
    samples : int
        How many.
    seed : int
        Of the random numbers.

    Returns
    -------
    ndarray, shape (samples,)

    Raises
    ------
    ValueError
        As `propagate`.
    """
    asked, _, _ = _scattering(answer, at, variation)
    z = np.random.default_rng(seed).standard_normal((samples, len(variation)))
    return _sampled(_values, asked, z)


def failure_probability(
    margin: Answer,
    at: Any,
    variation: Mapping[str, float],
    samples: int = 2000,
    seed: int = 0,
) -> Probability:
    """Probability that a smooth margin is negative, from the verge at its most likely point.

    First- and second-order reliability: in the space of independent standard normal numbers,
    the point of the verge next to the median, and the verge's curvature there. Samples then
    show whether the verge is like that.

    Parameters
    ----------
    margin : callable
        From a pytree of numbers to one number, smooth where it passes 0:
        `overturning_margin`, or the margin of a response.
    at : pytree
        Medians.
    variation : dict
        Coefficient of variation by name; see `propagate`.
    samples : int
        How many fates to compare with.
    seed : int
        Of the random numbers.

    Returns
    -------
    Probability
        `holds` is False where the method is not to be trusted.

    Raises
    ------
    ValueError
        As `propagate`; also if nothing scatters.

    Examples
    --------
    >>> import jaxrock as jr
    >>> wall = jr.Scene(jr.Block(0.4, 5.0), restitution=0.7, intensity=0.28)
    >>> scatter = {"intensity": 0.1, "restitution": 0.05}
    >>> chance = jr.failure_probability(jr.overturning_margin, wall, scatter)
    >>> print(f"{chance.probability:.3f}", chance.holds)
    0.245 True
    """
    asked, names, spread = _scattering(margin, at, variation)
    if not spread.any():
        raise ValueError("variation must be greater than 0 for at least one number")
    start = float(_value(asked, jnp.zeros(len(variation))))
    z, ended = _nearest(asked, len(variation))
    _, slope, curvature = map(np.asarray, _expanded(asked, jnp.asarray(z)))
    steep = float(np.linalg.norm(slope))
    away = -slope / steep if steep else np.zeros_like(slope)
    beta = float(away @ z)
    # Curvature of the verge in the plane that touches it there.
    basis = np.linalg.svd(away[None])[2][1:]
    curvature = basis @ curvature @ basis.T / (steep or 1.0)
    # Beyond where away . z > beta + u . K u / 2, u the rest of z.
    bend, twist = 0.5 * np.trace(curvature), 0.5 * (curvature**2).sum()
    first = _normal(-beta)
    second = _normal(-(beta + float(bend)) / (1 + float(twist)) ** 0.5)

    drawn = np.random.default_rng(seed).standard_normal((samples, len(variation)))
    fails = _sampled(_values, asked, drawn) < 0
    rest = drawn @ basis.T
    judged = drawn @ away > beta + 0.5 * np.einsum("ij,jk,ik->i", rest, curvature, rest)
    misjudged = float((fails != judged).mean())
    noise = 3 * (max(misjudged, 1 / samples) / samples) ** 0.5
    point = np.asarray(asked.numbers(jnp.asarray(z)))
    holds = ended and np.isfinite(start) and abs(fails.mean() - judged.mean()) < 0.01 + noise
    return Probability(
        second,
        first,
        beta,
        dict(zip(names, point.tolist(), strict=True)),
        misjudged,
        bool(holds and misjudged < 0.05),
    )


def global_sensitivities(
    answer: Answer,
    at: Any,
    ranges: Mapping[str, tuple[float, float]],
    samples: int = 4096,
    seed: int = 0,
) -> GlobalSensitivities:
    """Which numbers matter over whole ranges, from slopes at random points.

    Derivative-based global measures; a number whose bound is near 0 need not be known well.

    Parameters
    ----------
    answer : callable
        From a pytree of numbers to one number.
    at : pytree
        Where to ask for what is not given a range.
    ranges : dict
        Low and high value by name; uniform between them.
    samples : int
        How many points.
    seed : int
        Of the random numbers.

    Returns
    -------
    GlobalSensitivities

    Raises
    ------
    ValueError
        If a name is not one of `at`, or a range is empty.

    References
    ----------
    I. M. Sobol and S. Kucherenko, Derivative based global sensitivity measures and their link
    with global sensitivity indices, Math. Comput. Simul. 79 (2009) 3009-3017.
    """
    numbers = _Numbers.of(at)
    places = np.asarray(numbers.chosen("ranges", ranges))
    ends = np.asarray([ranges[name] for name in ranges], float).reshape(-1, 2)
    if not (ends[:, 1] > ends[:, 0]).all():
        raise ValueError("ranges must go from a low value to a higher one")
    asked = numbers.asked(answer, places)
    share = np.random.default_rng(seed).random((samples, len(ranges)))
    points = ends[:, 0] + share * (ends[:, 1] - ends[:, 0])
    found = _sampled(_slopes_and_values, asked, points)
    known = np.isfinite(found).all(axis=1)
    if not known.any():
        raise ValueError("answer is NaN everywhere in these ranges")
    slopes, values = found[known, :-1], found[known, -1]
    measure = (slopes**2).mean(axis=0)
    width = ends[:, 1] - ends[:, 0]
    variance = values.var()
    return GlobalSensitivities(
        tuple(ranges),
        abs(slopes).mean(axis=0),
        measure,
        measure * width**2 / (np.pi**2 * variance) if variance else np.zeros(len(ranges)),
        float(values.mean()),
        float(values.std()),
        float(1 - known.mean()),
    )


def _scattering(
    answer: Answer, at: Any, variation: Mapping[str, float]
) -> tuple[_Asked, tuple[str, ...], np.ndarray]:
    """The answer for independent standard normal numbers, the names, and what scatters."""
    numbers = _Numbers.of(at)
    places = np.asarray(numbers.chosen("variation", variation), int)
    spread = np.asarray(list(variation.values()), float)
    if not ((spread >= 0) & (spread < np.inf)).all():
        raise ValueError("variation must be at least 0 for every number")
    drawn = Distributions.of(tuple(variation), np.asarray(numbers.values)[places], spread)
    return numbers.asked(answer, places, drawn), numbers.names, spread


def _nearest(asked: _Asked, size: int) -> tuple[np.ndarray, bool]:
    """The point of the verge that is nearest to 0 (Hasofer, Lind, Rackwitz, Fiessler).

    Each step goes to the nearest point of the verge's tangent plane, or part of the way if
    that would not bring it nearer.
    """
    z = np.zeros(size)
    for _ in range(100):
        value, slope = (
            float(_value(asked, jnp.asarray(z))),
            np.asarray(_slope(asked, jnp.asarray(z))),
        )
        square = float(slope @ slope)
        if not np.isfinite(value) or not 0 < square < np.inf:
            return z, False
        change = (slope @ z - value) / square * slope - z
        if np.linalg.norm(change) < np.finfo(slope.dtype).eps ** 0.5:
            return z, True
        weight = 2 * max(np.linalg.norm(z) / square**0.5, 1e-3)

        def merit(z: np.ndarray, value: float, weight: float = weight) -> float:
            return 0.5 * float(z @ z) + weight * abs(value)

        share, now = 1.0, merit(z, value)
        while share > 1e-3:
            there = float(_value(asked, jnp.asarray(z + share * change)))
            if merit(z + share * change, there) < now:
                break
            share *= 0.5
        z = z + share * change
    return z, False


def _normal(x: float) -> float:
    return float(jax.scipy.stats.norm.cdf(x))


def _sampled(program: Callable[..., Any], asked: _Asked, points: np.ndarray) -> np.ndarray:
    """What is asked at every point, in parts that fit into memory."""
    parts = [
        np.asarray(program(asked, jnp.asarray(points[k : k + _TOGETHER])))
        for k in range(0, len(points), _TOGETHER)
    ]
    return np.concatenate(parts)
