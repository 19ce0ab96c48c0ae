"""The answer of a fit to outcomes: a population, and how much the tests say of it."""

import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ...block import Block
from ...ground_motion import Record, Suite
from ...host import Printed, describe_status, format_table
from ...sensitivity import Uncertain, find_coefficients
from ...validation import (
    Integers,
    Reals,
    check_kind,
    is_traced,
)
from .likelihood import (
    Points,
    TestData,
    compute_log_likelihood,
    compute_probability,
)
from .population import FREE_NAMES, NAMES, PAIRS, Population
from .sample import Simulator

# Fraction of the prior variance of a median: more left says that the tests do not decide it.
_UNDECIDED = 0.5
# From here on a lower end of the lapse is worth a remark, and so is a spread of blocks.
_HIGH_LAPSE = 0.05
_FEW_TESTS = 10
_FEW_BLOCKS = 50
_SAMPLES_OF_UNCERTAIN = 256
_UNITS = {"critical_angle": "rad", "frequency_parameter": "1/s"}


class OutcomeFit(Printed, eqx.Module):
    """A population of blocks fitted to tests that overturned or stood; see `fit_outcomes`.

    Attributes
    ----------
    population : Population
        The mode of the posterior: medians, deviations, correlations and lapse.
    block, restitution : Block, Array
        Block and coefficient of restitution at the medians.
    free, covariance : Array, shape (12,), (12, 12)
        Parameters of the population, transformed to unbounded ones (by logarithms, logits and
        the like), and their posterior covariance.
    draws, draw_weights : Array, shape (draws, 12), (draws,)
        Transformed parameters drawn from the posterior, and their weights, which add up to 1.
    prior_mean, prior_width : Array, shape (12,)
        Prior means and standard deviations of the transformed parameters.
    points : Points
        The sample of blocks.
    data : TestData
        Outcomes of the blocks of the sample in the tests, padded.
    counts : Array
        1 for the tests, 0 for the padding.
    effective_blocks : Array
        Effective sample size of the probabilities: 1 over the sum of squared weights.
    groups : int
        Number of groups of tests.
    grouped : bool
        Whether the tests of a group share a deviation.
    simulator : Simulator
        Settings that all blocks have in common.
    status : Array of int
        A `jaxrock.Status`: COMPLETE, or NOT_CONVERGED.
    """

    population: Population
    block: Block
    restitution: Reals
    free: Reals
    covariance: Reals
    draws: Reals
    draw_weights: Reals
    prior_mean: Reals
    prior_width: Reals
    points: Points
    data: TestData
    counts: Reals
    effective_blocks: Reals
    status: Integers
    groups: int = eqx.field(static=True)
    grouped: bool = eqx.field(static=True)
    simulator: Simulator = eqx.field(static=True)

    @property
    def tests(self) -> int:
        """Number of tests."""
        return int(np.asarray(self.counts).sum())

    @property
    def uncertain(self) -> Uncertain:
        """The block of a further test as an `Uncertain`, for fragilities, rates, inventories.

        It does not include the lapse. The deviation of its critical angle includes the
        deviation between groups.

        Raises
        ------
        ValueError
            If the restitution is so uncertain that its density has two peaks.
        """
        population = jax.tree.map(lambda leaf: np.asarray(leaf, float), self.population)
        within = population.deviations
        total = np.hypot(within, [population.group_deviation, 0.0, 0.0])
        medians = [float(getattr(population, name)) for name in NAMES]
        coefficients = find_coefficients(NAMES, medians, total)
        # A deviation of groups adds to the variance of one, and nothing to covariances.
        kept = within / total
        correlations = {
            (NAMES[k], NAMES[m]): float(r * kept[k] * kept[m])
            for (k, m), r in zip(PAIRS, population.correlations, strict=True)
        }
        return Uncertain(
            dict(zip(NAMES, coefficients.tolist(), strict=True)),
            correlations=correlations,
            samples=_SAMPLES_OF_UNCERTAIN,
        )

    def compute_intervals(self, confidence: float = 0.9) -> dict[str, tuple[float, float]]:
        """Compute intervals of the parameters of the population, by name.

        Parameters
        ----------
        confidence : float
            Between 0 and 1.

        Returns
        -------
        dict of tuple of float
            Both ends, in the units of `Population`. Correlations are partial: the last one is
            the correlation at a given critical angle.

        Raises
        ------
        ValueError
            If `confidence` is not between 0 and 1.
        """
        if not isinstance(confidence, float | int) or not 0 < confidence < 1:
            raise ValueError(
                f"confidence must be a number between 0 and 1, got {confidence!r:.60}"
            )
        draws = np.asarray(self.draws, float)
        weights = np.asarray(self.draw_weights, float)
        tail = 0.5 * (1 - confidence)
        low, high = (
            np.array([_find_quantile(column, weights, part) for column in draws.T])
            for part in (tail, 1 - tail)
        )
        ends = [_list_numbers(low), _list_numbers(high)]
        return {
            name: (float(low), float(high))
            for name, low, high in zip(FREE_NAMES, *ends, strict=True)
        }

    @property
    def undecided(self) -> tuple[str, ...]:
        """Names of the medians whose uncertainty is still mostly that of the prior."""
        variance = np.diagonal(np.asarray(self.covariance, float))[: len(NAMES)]
        left = variance / np.asarray(self.prior_width, float)[: len(NAMES)] ** 2
        return tuple(name for name, part in zip(NAMES, left, strict=True) if part > _UNDECIDED)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks to read before using the results."""
        sentences = []
        status = describe_status(self.status)
        if status:
            sentences.append(status)
        overturned = int((np.asarray(self.data.overturned) * np.asarray(self.counts)).sum())
        if self.tests < _FEW_TESTS:
            sentences.append(
                f"there are {self.tests} tests only: most of the answer is the prior"
                if self.tests > 1
                else "there is one test only: most of the answer is the prior"
            )
        if overturned in (0, self.tests):
            what = "all tests overturned" if overturned else "no test overturned"
            sentences.append(f"{what}: they bound the population from one side only")
        if self.undecided:
            names = " and ".join(name.replace("_", " ") for name in self.undecided)
            sentences.append(f"the tests hardly determine the {names}")
        lapse = self.compute_intervals()["lapse"][0]
        if lapse > _HIGH_LAPSE:
            sentences.append(
                f"at least {lapse:.0%} of the outcomes fit no block of the population: check"
                " outcomes and motions"
            )
        if float(self.effective_blocks) < _FEW_BLOCKS:
            sentences.append(
                f"probabilities rest on {float(self.effective_blocks):.0f} blocks only: take more"
                " samples"
            )
        return tuple(sentences)

    def table(self) -> dict[str, list[Any]]:
        """List the parameters of the population, a row each, with their 90 % intervals.

        Returns
        -------
        dict of list
            ``parameter``, ``value``, ``low`` and ``high``.
        """
        intervals = self.compute_intervals()
        # Its fields are in the order of the intervals.
        fields = jax.tree.leaves(self.population)
        values = np.concatenate([np.ravel(field) for field in fields]).tolist()
        # The interval of the last correlation is that of a partial one.
        intervals["correlation_frequency_parameter_restitution"] = (np.nan, np.nan)
        rows = [
            (name, value, *interval)
            for (name, interval), value in zip(intervals.items(), values, strict=True)
            if self._is_determined(name)
        ]
        heads = ("parameter", "value", "low", "high")
        return dict(zip(heads, map(list, zip(*rows, strict=True)), strict=True))

    def _is_determined(self, name: str) -> bool:
        """Return whether the tests say anything of a parameter."""
        if name == "group_deviation":
            return self.grouped
        return name != "peak_deviation" or self.data.log_peak is not None

    def __str__(self) -> str:
        overturned = int((np.asarray(self.data.overturned) * np.asarray(self.counts)).sum())
        in_groups = f" in {self.groups} groups" if self.grouped else ""
        head = f"{self.tests} tests{in_groups}, {overturned} overturned; with 90 % intervals"
        intervals = self.compute_intervals()
        values = _list_numbers(np.asarray(self.free, float))
        shown = [
            k
            for k, name in enumerate(FREE_NAMES)
            if not name.startswith("correlation") and self._is_determined(name)
        ]
        names = []
        for k in shown:
            name = FREE_NAMES[k]
            unit = f" [{_UNITS[name]}]" if name in _UNITS else ""
            words = name.replace("_", " ")
            if name.endswith("_deviation") and name.removesuffix("_deviation") in NAMES:
                of = "logit" if name.startswith("restitution") else "log"
                words = (
                    f"deviation of {of} {name.removesuffix('_deviation').replace('_', ' ')}"
                )
            names.append(words + unit)
        table = format_table(
            head,
            names,
            value=[values[k] for k in shown],
            low=[intervals[FREE_NAMES[k]][0] for k in shown],
            high=[intervals[FREE_NAMES[k]][1] for k in shown],
        )
        return "\n".join([table, *self.remarks])

    def probability(
        self, motions: Suite | Record, population: Population | None = None
    ) -> Reals:
        """Compute the probability that a test under each motion overturns.

        The block of the test is drawn anew from the population, its group is unknown, and
        lapses are included.

        Parameters
        ----------
        motions : Suite or Record
            Concrete.
        population : Population, optional
            A population near the fitted one. It may be traced: derivatives are those of the
            weights of the sample, whose outcomes stay fixed.

        Returns
        -------
        Array, shape (records,)
            Probabilities [-]; of shape () for a single record.

        Raises
        ------
        ValueError
            If motions are traced, or an integration does not finish.
        """
        single = isinstance(motions, Record)
        suite = Suite([motions]) if isinstance(motions, Record) else motions
        check_kind("motions", suite, Suite)
        if is_traced(suite):
            raise ValueError("motions must be concrete here: outcomes have no derivatives")
        coordinates = np.asarray(self.points.coordinates, float)
        # In a transformation, too, the outcomes are numbers: only the population is traced.
        with jax.ensure_compile_time_eval():
            overturned, _ = self.simulator.simulate(coordinates, suite)
        outcomes = jnp.asarray(overturned, self.points.coordinates.dtype)
        chosen = self.population if population is None else population
        probability = _compute_probability(chosen, self.points, outcomes)
        return probability[0] if single else probability

    def log_likelihood(self, population: Population | None = None) -> Reals:
        """Compute the log-likelihood of the tests under a population near the fitted one.

        Parameters
        ----------
        population : Population, optional
            The fitted one by default. It may be traced.

        Returns
        -------
        Array, shape ()
        """
        chosen = self.population if population is None else population
        return _compute_log_likelihood(
            chosen, self.points, self.data, self.counts, self.grouped
        )


_compute_probability = jax.jit(compute_probability)


@functools.partial(jax.jit, static_argnums=4)
def _compute_log_likelihood(
    population: Population, points: Points, data: TestData, counts: Reals, grouped: bool
) -> Reals:
    """Compute the logarithm of the likelihood in one program."""
    return compute_log_likelihood(population, points, data, counts, grouped=grouped)


def _find_quantile(values: np.ndarray, weights: np.ndarray, part: float) -> float:
    """Find the value below which a part of the weights is, between two draws by a line."""
    order = np.argsort(values)
    middles = np.cumsum(weights[order]) - 0.5 * weights[order]
    return float(np.interp(part, middles, values[order]))


def _list_numbers(free: np.ndarray) -> np.ndarray:
    """List the numbers of a population in the order of `FREE_NAMES`; partial correlations."""
    medians = [*np.exp(free[:2]), 1 / (1 + np.exp(-free[2]))]
    lapse = 1 / (1 + np.exp(-free[9]))
    return np.array(
        [*medians, *np.exp(free[3:6]), *np.tanh(free[6:9]), lapse, *np.exp(free[10:])]
    )
