"""A campaign of tests, checked once, and the populations fitted to subsets of its tests."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...block import RECTANGLE_INERTIA_RATIO
from ...ground_motion import Suite
from ...host import show_progress
from ...resonance import ModelLike, Nonlinear, as_model
from ...validation import (
    AT_LEAST_ONE,
    POSITIVE,
    Domain,
    Flags,
    Number,
    as_array,
    as_flag,
    as_real,
    check,
    check_concrete,
    check_kind,
    describe,
)
from .likelihood import Points, TestData
from .population import NAMES
from .posterior import (
    Evidence,
    Mode,
    Posterior,
    compute_covariance,
    propose_blocks,
    sample_posterior,
    search_mode,
)
from .prior import Prior, PriorLike, make_prior
from .sample import NormalComponent, Simulator, draw_sample

# Number of blocks from populations that fit, over the number from the prior.
_OF_PRIOR = 2
# Tests are padded to this number times a power of 2: each number of tests would be another
# program.
_LEAST_ROOM = 64
_LEAST_SAMPLES = 64
# Default number of simulated motions. Fewer tests have more blocks, since otherwise single
# blocks would dominate the likelihood.
_USUAL_MOTIONS = 2**20
_USUAL_SAMPLES = (2048, 8192)  # smallest and largest default
# Nodes of the quadrature over the deviation of a group: exact for polynomials up to degree 9.
_NODES = 5


class Campaign(NamedTuple):
    """Tests of blocks, each under a motion of its own.

    Attributes
    ----------
    suite : Suite
        The motions.
    overturned : ndarray of bool, shape (tests,)
    groups : tuple of str
        The names of the groups.
    group : ndarray of int, shape (tests,)
        Index in `groups` of the group of each test.
    simulator : Simulator
    prior : Prior
    samples, seed : int
        Number of blocks besides the blocks from the prior, and the seed of all of them.
    """

    suite: Suite
    overturned: np.ndarray
    groups: tuple[str, ...]
    group: np.ndarray
    simulator: Simulator
    prior: Prior
    samples: int
    seed: int

    @property
    def grouped(self) -> bool:
        """Whether deviations of groups and of tests can be distinguished."""
        return 1 < len(self.groups) < len(self.overturned)

    def pad(self, values: np.ndarray) -> np.ndarray:
        """Pad values of tests by zeros, along their first axis, to the room that tests have."""
        room = max(_LEAST_ROOM, 1 << (len(self.overturned) - 1).bit_length())
        padding = [(0, room - len(values))] + [(0, 0)] * (values.ndim - 1)
        return np.pad(values, padding)

    def draw_evidence(self, components: Sequence[NormalComponent]) -> Evidence:
        """Draw blocks from normal distributions, and simulate them in the tests."""
        sample = draw_sample(self.simulator, self.suite, components, self.seed)
        coordinates, log_density, outcomes = sample
        nodes, weights = np.polynomial.hermite_e.hermegauss(_NODES if self.grouped else 1)
        blocks = (coordinates, log_density, nodes, weights / weights.sum())
        tests = (outcomes.astype(float), self.overturned.astype(float), self.group)
        data = TestData(*(as_array(self.pad(values)) for values in tests))
        return Evidence(self.prior, Points(*map(as_array, blocks)), data)


def check_campaign(  # noqa: PLR0913
    suite: Suite,
    overturned: Flags,
    groups: Sequence[object] | None = None,
    *,
    prior: PriorLike | None = None,
    samples: int | None = None,
    seed: int = 0,
    model: ModelLike = Nonlinear(),
    gravity: Number = 9.81,
    inertia_ratio: Number = RECTANGLE_INERTIA_RATIO,
    one_sided: bool = False,
) -> Campaign:
    """Check the arguments of `fit_outcomes`, whose docstring describes them."""
    check_kind("suite", suite, Suite)
    check_concrete(
        (suite, overturned, prior, gravity, inertia_ratio),
        "a fit searches on the host",
    )
    number = len(suite)
    outcomes = np.asarray(overturned)
    if outcomes.shape != (number,) or not np.isin(outcomes, (0, 1)).all():
        raise ValueError(
            f"overturned must be True or False, or 1 or 0, for each of {number} motions, got"
            f" {describe(overturned)}"
        )
    outcomes = outcomes.astype(bool)
    labels = np.asarray(range(number) if groups is None else groups, str)
    names, group = np.unique(labels, return_inverse=True)
    if group.shape != (number,):
        raise ValueError(
            f"groups must have a name for each of {number} motions, got {describe(groups)}"
        )
    if samples is None:
        least, most = _USUAL_SAMPLES
        samples = min(max(1 << (_USUAL_MOTIONS // number).bit_length() - 1, least), most)
    if type(samples) is not int or samples < _LEAST_SAMPLES or samples & (samples - 1):
        raise ValueError(
            f"samples must be a power of 2 from {_LEAST_SAMPLES} on, got {samples!r:.60}"
        )
    if type(seed) is not int or seed < 0:
        raise ValueError(f"seed must be a whole number from 0 on, got {seed!r:.60}")
    simulator = Simulator(
        _as_single("gravity", gravity, "m/s2", POSITIVE),
        _as_single("inertia_ratio", inertia_ratio, "", AT_LEAST_ONE),
        as_flag("one_sided", one_sided),
        as_model(model),
    )
    checked = (suite, outcomes, tuple(names.tolist()), group, simulator)
    return Campaign(*checked, make_prior(prior), samples, seed)


def _as_single(name: str, value: object, unit: str, domain: Domain) -> float:
    """Convert to a single number that is allowed."""
    number = as_real(name, value, unit=unit)
    if number.shape:
        raise ValueError(f"{name} must be a single number, got {describe(value)}")
    check(name, number, domain)
    return float(number)


class CampaignFit(NamedTuple):
    """Populations fitted to subsets of the tests of a campaign, from one sample of blocks.

    Attributes
    ----------
    evidence : Evidence
    modes : list of Mode
        For each subset.
    posterior : Posterior
        Of the first subset.
    """

    evidence: Evidence
    modes: list[Mode]
    posterior: Posterior


def fit_parts(campaign: Campaign, subsets: Sequence[np.ndarray]) -> CampaignFit:
    """Fit a population to each subset of the tests, from one sample of blocks.

    Blocks from the prior lead to a population that fits the first subset. Around it, and wide
    enough for the populations of all subsets, more blocks are drawn. The distribution of the
    blocks changes the accuracy of an answer, not its limit for many blocks.

    Parameters
    ----------
    campaign : Campaign
    subsets : sequence of ndarray of bool, shape (tests,)
        Which tests count.
    """
    counts = [campaign.pad(subset.astype(float)) for subset in subsets]
    mean, width = (
        np.array([float(getattr(population, name)) for name in NAMES])
        for population in campaign.prior
    )
    widest = NormalComponent(mean, np.diag(width), campaign.samples // _OF_PRIOR)
    evidence = campaign.draw_evidence([widest])
    mode = search_mode(evidence, counts[0], np.zeros(len(vars(campaign.prior.mean))))
    covariance = compute_covariance(mode, evidence, counts[0])
    # The fewer the tests, the less certain the medians.
    fewest = min(subset.sum() for subset in counts)
    proposed = propose_blocks(mode, covariance * counts[0].sum() / fewest, campaign.prior)
    evidence = campaign.draw_evidence([widest, NormalComponent(*proposed, campaign.samples)])
    shown = show_progress(counts, "fits")
    modes = [search_mode(evidence, count, mode.standard) for count in shown]
    covariance = compute_covariance(modes[0], evidence, counts[0])
    posterior = sample_posterior(modes[0], covariance, evidence, counts[0], campaign.seed)
    return CampaignFit(evidence, modes, posterior)
