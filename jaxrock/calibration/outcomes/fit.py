"""Blocks from tests that overturned or stood: the population that explains them best."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ...block import RECTANGLE_INERTIA_RATIO, Block
from ...ground_motion import Suite
from ...host import Status
from ...resonance import ModelLike, Nonlinear
from ...validation import Flags, Number, Numbers, as_array
from .answer import OutcomeFit
from .campaign import Campaign, CampaignFit, check_campaign, fit_parts
from .population import unpack_population
from .prior import PriorLike


def fit_outcomes(  # noqa: PLR0913
    suite: Suite,
    overturned: Flags,
    *,
    prior: PriorLike | None = None,
    groups: Sequence[object] | None = None,
    peak_rotations: Numbers | None = None,
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
    peak_rotations : array_like, shape (tests,), optional
        Measured peak rotations [rad]; NaN where unknown. Those of blocks that overturned are
        left out.
    samples : int, optional
        Number of blocks in the sample, a power of 2 from 64 on. A quarter more is drawn from
        the prior, and more again if few blocks have weight. By default 8,192 for up to 128
        tests, 4,096 for up to 256, 2,048 for more.
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
    >>> fit = jr.fit_outcomes(suite, overturned, prior=block, samples=256)
    >>> print(fit.tests, fit.undecided)
    20 ('critical_angle', 'frequency_parameter')
    """
    campaign = check_campaign(
        suite,
        overturned,
        groups,
        peak_rotations,
        prior,
        samples,
        seed,
        model,
        gravity,
        inertia_ratio,
        one_sided,
    )
    return make_outcome_fit(campaign, fit_parts(campaign, [np.ones(len(suite), bool)]))


def make_outcome_fit(campaign: Campaign, fitted: CampaignFit) -> OutcomeFit:
    """Make the answer of the first part of a fit, which has to be of all tests."""
    searched = fitted.searched[0]
    population = unpack_population(searched.free)
    if not campaign.grouped:
        population = eqx.tree_at(
            lambda p: p.group_deviation, population, jnp.zeros_like(population.lapse)
        )
    simulator = campaign.simulator
    block = Block.from_parameters(
        population.frequency_parameter,
        population.critical_angle,
        simulator.gravity,
        simulator.inertia_ratio,
        one_sided=simulator.one_sided,
    )
    number = len(campaign.overturned)
    return OutcomeFit(
        population=population,
        block=block,
        restitution=population.restitution,
        free=searched.free,
        covariance=as_array(fitted.posterior.covariance),
        draws=as_array(fitted.posterior.free),
        draw_weights=as_array(fitted.posterior.weights),
        prior_mean=as_array(campaign.prior.mean),
        prior_width=as_array(campaign.prior.width),
        points=fitted.sample.points,
        data=fitted.data,
        counts=as_array(campaign.pad(np.ones(number))),
        effective_blocks=as_array(np.asarray(fitted.effective_blocks)),
        status=as_array(
            np.asarray(Status.COMPLETE if bool(searched.converged) else Status.NOT_CONVERGED)
        ),
        groups=len(campaign.groups),
        grouped=campaign.grouped,
        simulator=simulator,
    )
