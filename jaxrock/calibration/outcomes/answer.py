"""Blocks from tests that overturned or stood: a population and its posterior uncertainty."""

import itertools
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.special import expit, logit

from ...block import RECTANGLE_INERTIA_RATIO, Block
from ...ground_motion import Record, Suite
from ...host import Printed, describe_status, format_table
from ...resonance import ModelLike, Nonlinear
from ...sensitivity import Uncertain
from ...validation import Flags, Integers, Number, Reals, as_array, check_kind, is_traced
from .campaign import Campaign, CampaignFit, check_campaign, fit_parts
from .likelihood import Points, compute_probability, weigh_blocks
from .population import NAMES, UNITS, Population
from .posterior import scale_to_prior
from .prior import PriorLike
from .sample import Simulator

# Fraction of the prior variance of a median above which the tests do not decide it.
_UNDECIDED = 0.5
# Lower limit of the lapse, or spread of blocks, above which there is a remark.
_HIGH_LAPSE = 0.05
_FEW_TESTS = 10
_FEW_BLOCKS = 50
_SAMPLES_OF_UNCERTAIN = 256
_TAIL = 0.05  # at either end of an interval


class OutcomeFit(Printed, eqx.Module):
    """A population of blocks fitted to tests that overturned or stood; see `fit_outcomes`.

    Attributes
    ----------
    population : Population
        The mode of the posterior: medians, deviations, correlations and lapse.
    draws : Population
        Populations drawn from the posterior; leaves of shape (draws,).
    draw_weights : Array, shape (draws,)
        Their weights, which add up to 1.
    points : Points
        The sample of blocks.
    status : Array of int
        A `jaxrock.Status`: COMPLETE, or NOT_CONVERGED.
    tests, overturned, groups : int
        Numbers of tests, of those that overturned, and of groups.
    undecided : tuple of str
        Names of the medians whose uncertainty is still mostly that of the prior.
    grouped : bool
        Whether deviations of groups and of tests can be distinguished.
    simulator : Simulator
        Settings that all blocks have in common.
    """

    population: Population
    draws: Population
    draw_weights: Reals
    points: Points
    status: Integers
    tests: int = eqx.field(static=True)
    overturned: int = eqx.field(static=True)
    groups: int = eqx.field(static=True)
    undecided: tuple[str, ...] = eqx.field(static=True)
    grouped: bool = eqx.field(static=True)
    simulator: Simulator = eqx.field(static=True)

    @property
    def restitution(self) -> Reals:
        """Median coefficient of restitution [-]."""
        return self.population.restitution

    @property
    def block(self) -> Block:
        """Block at the medians."""
        return Block.from_parameters(
            self.population.frequency_parameter,
            self.population.critical_angle,
            self.simulator.gravity,
            self.simulator.inertia_ratio,
            one_sided=self.simulator.one_sided,
        )

    @property
    def uncertain(self) -> Uncertain:
        """The block of a further test as an `Uncertain`, for fragilities, rates, inventories.

        It does not include the lapse. The deviation of its critical angle includes the
        deviation between groups.
        """
        values = {name: float(value) for name, value in vars(self.population).items()}
        angle, frequency, odds = (values[f"{name}_deviation"] for name in NAMES)
        total = np.hypot(angle, values["group_deviation"])
        nodes, weights = np.polynomial.hermite_e.hermegauss(20)
        restitutions = expit(logit(values["restitution"]) + odds * nodes)
        mean, square = (np.average(restitutions**k, weights=weights) for k in (1, 2))
        coefficients = {
            "critical_angle": np.sqrt(np.expm1(total**2)),
            "frequency_parameter": np.sqrt(np.expm1(frequency**2)),
            "restitution": np.sqrt(square - mean**2) / mean,
        }
        # A deviation of groups adds to the variance of the angle, but not to covariances.
        factors = dict.fromkeys(NAMES, 1.0) | {"critical_angle": angle / total}
        correlations = {
            (first, second): values[f"correlation_{first}_{second}"] * factors[first]
            for first, second in itertools.combinations(NAMES, 2)
        }
        return Uncertain(
            {name: float(value) for name, value in coefficients.items()},
            correlations=correlations,
            samples=_SAMPLES_OF_UNCERTAIN,
        )

    @property
    def effective_blocks(self) -> Reals:
        """Effective sample size of the probabilities: 1 over the sum of squared weights."""
        return _count_effective_blocks(self.population, self.points)

    def compute_intervals(self) -> dict[str, tuple[float, float]]:
        """Compute 90 % intervals of the parameters of the population, by name.

        Returns
        -------
        dict of tuple of float
            Both ends, in the units of `Population`.
        """
        weights = np.asarray(self.draw_weights, float)
        intervals = {}
        for name, draws in vars(self.draws).items():
            order = np.argsort(draws)
            middles = np.cumsum(weights[order]) - 0.5 * weights[order]
            low, high = np.interp([_TAIL, 1 - _TAIL], middles, np.asarray(draws)[order])
            intervals[name] = float(low), float(high)
        return intervals

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks to read before using the results."""
        undecided = " and ".join(self.undecided).replace("_", " ")
        lapse = self.compute_intervals()["lapse"][0]
        outcome = "all tests" if self.overturned else "no test"
        remarks = {
            describe_status(self.status): True,
            f"most of the answer is the prior: tests {self.tests}": self.tests < _FEW_TESTS,
            f"{outcome} overturned: they bound the population from one side only": self.overturned
            in (0, self.tests),
            f"the tests hardly determine the {undecided}": undecided,
            f"at least {lapse:.0%} of the outcomes fit no block of the population: check outcomes"
            " and motions": lapse > _HIGH_LAPSE,
            f"probabilities rest on {float(self.effective_blocks):.0f} blocks only: take more"
            " samples": self.effective_blocks < _FEW_BLOCKS,
        }
        return tuple(remark for remark, applies in remarks.items() if remark and applies)

    def table(self) -> dict[str, list[Any]]:
        """List the parameters of the population, a row each, with their 90 % intervals.

        Returns
        -------
        dict of list
            ``parameter``, ``value``, ``low`` and ``high``.
        """
        rows = [
            (name, float(getattr(self.population, name)), *interval)
            for name, interval in self.compute_intervals().items()
            if self.grouped or name != "group_deviation"
        ]
        heads = ("parameter", "value", "low", "high")
        return dict(zip(heads, map(list, zip(*rows, strict=True)), strict=True))

    def __str__(self) -> str:
        grouping = f" in {self.groups} groups" if self.grouped else ""
        head = f"{self.tests} tests{grouping}, {self.overturned} overturned"
        table = self.table()
        names = [
            name.replace("_", " ") + (f" [{UNITS[name]}]" if name in UNITS else "")
            for name in table.pop("parameter")
        ]
        table = format_table(f"{head}; with 90 % intervals", names, **table)
        return "\n".join([table, *self.remarks])

    def probability(self, motions: Suite | Record) -> Reals:
        """Compute the probability that a test under each motion overturns.

        The block of the test is drawn anew from the population, its group is unknown, and
        lapses are included. The result may be differentiated with respect to `population`: its
        derivatives are those of the weights of the sample, whose outcomes stay fixed.

        Parameters
        ----------
        motions : Suite or Record
            Concrete.

        Returns
        -------
        Array, shape (records,)
            Probabilities [-]; of shape () for a single record.

        Raises
        ------
        ValueError
            If motions are traced, or an integration does not finish.
        """
        suite = Suite([motions]) if isinstance(motions, Record) else motions
        check_kind("motions", suite, Suite)
        if is_traced(suite):
            raise ValueError("motions must be concrete here: outcomes have no derivatives")
        coordinates = np.asarray(self.points.coordinates, float)
        # The outcomes are numbers even in a transformation: only the population is traced.
        with jax.ensure_compile_time_eval():
            overturned = self.simulator.simulate(coordinates, suite)
        outcomes = jnp.asarray(overturned, self.points.coordinates.dtype)
        probability = _compute_probability(self.population, self.points, outcomes)
        return probability[0] if isinstance(motions, Record) else probability


_compute_probability = jax.jit(compute_probability)


@jax.jit
def _count_effective_blocks(population: Population, points: Points) -> Reals:
    """Count the blocks on which probabilities rest."""
    return 1 / jnp.sum((weigh_blocks(population, points) @ points.node_weights) ** 2)


def fit_outcomes(  # noqa: PLR0913
    suite: Suite,
    overturned: Flags,
    *,
    prior: PriorLike | None = None,
    groups: Sequence[object] | None = None,
    samples: int | None = None,
    seed: int = 0,
    model: ModelLike = Nonlinear(),
    gravity: Number = 9.81,
    inertia_ratio: Number = RECTANGLE_INERTIA_RATIO,
    one_sided: bool = False,
) -> OutcomeFit:
    """Fit a population of blocks to tests on a shaking table that overturned or stood.

    A single rocking motion cannot be predicted, but the statistics of many can (Bachmann et
    al. 2018, https://doi.org/10.1002/eqe.2978). So each test has a block of its own, from a
    population that is normal in ln(alpha_c), ln(p) and logit(C). A sample of blocks is
    simulated once under all motions. The probability of each outcome is a weighted mean over
    this sample. The weights are smooth functions of the population, so the mode of the
    posterior is found by gradients.

    Parameters
    ----------
    suite : Suite
        The motion of each test; on the ground or on a floor, with a vertical component or not.
    overturned : array_like of bool, shape (tests,)
        Whether the block of each test overturned.
    prior : Block, FreeRockingFit or mapping, optional
        Prior of the medians: a block of known size, a test of free rocking, or a median and
        its coefficient of variation for any of "critical_angle" [rad], "frequency_parameter"
        [1/s] and "restitution" [-]. By default it is nearly uninformative.
    groups : sequence of str, optional
        A name for each test, such as that of the earthquake. Tests of a group share an error
        of the model. By default all tests are independent.
    samples : int, optional
        Number of blocks in the sample, a power of 2 from 64 on. Half as many more are drawn
        from the prior. By default 8,192 for up to 128 tests, 4,096 for up to 256, 2,048 for
        more.
    seed : int
        Seed of the Sobol points.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.
    gravity, inertia_ratio : float
        g [m/s2] and I_O / (m R^2) [-]; outcomes cannot distinguish their effects from that of
        p.
    one_sided : bool
        Whether the blocks stand against a wall.

    Returns
    -------
    OutcomeFit

    Raises
    ------
    ValueError
        If an argument is out of range, traced or of the wrong shape; if the integration of a
        motion does not finish.

    Notes
    -----
    Outcomes alone leave a ridge in the posterior: a block that is more slender, is larger and
    loses more energy behaves much like one that is stockier, is smaller and loses less.
    `OutcomeFit.undecided` names the medians that the
    tests do not determine.

    The sample is simulated in single precision.

    Examples
    --------
    >>> import jaxrock as jr, numpy as np
    >>> suite = jr.example_suite().scaled(np.linspace(0.5, 2.0, 20))
    >>> block, restitution = jr.Block(0.1, 6.0), 0.9
    >>> overturned = jr.respond_batch(block, restitution, suite).overturned
    >>> fit = jr.calibration.fit_outcomes(suite, overturned, prior=block, samples=256)
    >>> print(fit.tests, fit.undecided)
    20 ('critical_angle', 'frequency_parameter')
    """
    campaign = check_campaign(
        suite,
        overturned,
        groups,
        prior=prior,
        samples=samples,
        seed=seed,
        model=model,
        gravity=gravity,
        inertia_ratio=inertia_ratio,
        one_sided=one_sided,
    )
    return make_outcome_fit(campaign, fit_parts(campaign, [np.ones(len(suite), bool)]))


def make_outcome_fit(campaign: Campaign, fitted: CampaignFit) -> OutcomeFit:
    """Make the answer from the first subset of a fit, which has to contain all tests."""
    mode, posterior, prior = fitted.modes[0], fitted.posterior, campaign.prior
    population = scale_to_prior(as_array(mode.standard), prior)
    if not campaign.grouped:
        zero = jnp.zeros_like(population.lapse)
        population = eqx.tree_at(lambda p: p.group_deviation, population, zero)
    variances = dict(zip(vars(population), posterior.variances, strict=True))
    return OutcomeFit(
        population=population,
        draws=jax.vmap(scale_to_prior, (0, None))(as_array(posterior.standard), prior),
        draw_weights=as_array(posterior.weights),
        points=fitted.evidence.points,
        status=as_array(np.asarray(mode.status)),
        tests=len(campaign.overturned),
        overturned=int(campaign.overturned.sum()),
        groups=len(campaign.groups),
        undecided=tuple(name for name in NAMES if variances[name] > _UNDECIDED),
        grouped=campaign.grouped,
        simulator=campaign.simulator,
    )
