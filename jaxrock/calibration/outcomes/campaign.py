"""A campaign of tests, checked once, and the sample of blocks that its fits need."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...ground_motion import Suite
from ...host import show_progress
from ...resonance import ModelLike, as_model
from ...validation import (
    AT_LEAST_ONE,
    POSITIVE,
    Domain,
    Flags,
    Number,
    Numbers,
    as_array,
    as_flag,
    as_real,
    check,
    check_concrete,
    check_kind,
    describe,
)
from ..free_rocking_motion import OUTSIDE
from .likelihood import TestData
from .posterior import Posterior, sample_posterior
from .prior import Prior, PriorLike, make_prior
from .sample import PEAK_FLOOR, BlockSample, NormalComponent, Simulator, draw_sample
from .search import (
    Searched,
    compute_covariance,
    count_effective_blocks,
    propose_blocks,
    search_population,
)

# Blocks of the first stage, drawn from the prior, over those of the second.
_FIRST_STAGE = 4
# A population that rests on fewer blocks gets more of its own, at most so many times.
_ENOUGH_BLOCKS = 150.0
_MOST_ROUNDS = 4
# Tests are padded to so many, or twice as many and so on: each number of them would be another
# program.
_LEAST_ROOM = 64
_LEAST_SAMPLES = 64  # with fewer the first stage is none
# By default so many motions of blocks of the second stage: some 15 s on two processors. The
# fewer the tests, the more a fit hangs on single blocks.
_USUAL_MOTIONS = 2**20
_USUAL_SAMPLES = (2048, 8192)  # at least, at most


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
        Places of the tests' groups in `groups`.
    peak_rotations : ndarray, shape (tests,), or None
        Measured [rad]; NaN where unknown.
    simulator : Simulator
    prior : Prior
    samples, seed : int
        Blocks of the second stage, and the seed of all.
    """

    suite: Suite
    overturned: np.ndarray
    groups: tuple[str, ...]
    group: np.ndarray
    peak_rotations: np.ndarray | None
    simulator: Simulator
    prior: Prior
    samples: int
    seed: int

    @property
    def grouped(self) -> bool:
        """True where a deviation of groups can be told from that of tests."""
        return 1 < len(self.groups) < len(self.overturned)

    def make_data(self, sample: BlockSample) -> TestData:
        """Make the arrays of the likelihood, padded with tests that must not count."""
        number = len(self.overturned)
        padding = self.room - number
        rows = ((0, padding), (0, 0))
        log_peak = log_peaks = None
        if self.peak_rotations is not None and sample.peaks is not None:
            peak = np.pad(self.peak_rotations, (0, padding), constant_values=np.nan)
            log_peak = as_array(np.log(peak + PEAK_FLOOR))
            peaks = np.pad(sample.peaks.astype(float), rows)
            # Peaks of blocks that overturn are NaN, and count nowhere.
            log_peaks = as_array(np.log(np.nan_to_num(peaks) + PEAK_FLOOR))
        return TestData(
            outcomes=as_array(np.pad(sample.overturned, rows).astype(float)),
            overturned=as_array(np.pad(self.overturned, (0, padding)).astype(float)),
            group=as_array(np.pad(self.group, (0, padding))),
            log_peak=log_peak,
            log_peaks=log_peaks,
        )

    @property
    def room(self) -> int:
        """The number of tests with the padding."""
        room = _LEAST_ROOM
        while room < len(self.overturned):
            room *= 2
        return room

    def pad(self, counts: np.ndarray) -> np.ndarray:
        """Pad the counts of tests by zeros."""
        return np.pad(counts.astype(float), (0, self.room - len(counts)))


def check_campaign(  # noqa: C901, PLR0913
    suite: Suite,
    overturned: Flags,
    groups: Sequence[object] | None,
    peak_rotations: Numbers | None,
    prior: PriorLike | None,
    samples: int | None,
    seed: int,
    model: ModelLike,
    gravity: Number,
    inertia_ratio: Number,
    one_sided: bool,
) -> Campaign:
    """Check the arguments of `fit_outcomes`, which says what they may be."""
    check_kind("suite", suite, Suite)
    number = len(suite)
    for name, record in zip(suite.names, suite, strict=True):
        if np.ndim(record.scale):
            raise ValueError(
                "scales of records must be single numbers, got an array of shape"
                f" {np.shape(record.scale)} for {name!r}"
            )
    check_concrete((suite, overturned, peak_rotations, prior, gravity, inertia_ratio), OUTSIDE)
    outcomes = np.asarray(overturned)
    if outcomes.shape != (number,):
        raise ValueError(
            f"overturned must have a value for each of {number} motions, got {describe(overturned)}"
        )
    if not np.isin(outcomes, (0, 1)).all():
        raise ValueError(
            f"overturned must be True or False, or 1 or 0, got {describe(overturned)}"
        )
    outcomes = outcomes.astype(bool)
    names, places = _check_groups(groups, number)
    peaks = None
    if peak_rotations is not None:
        peaks = np.asarray(as_real("peak_rotations", peak_rotations, unit="rad"), float)
        if peaks.shape != (number,):
            raise ValueError(
                f"peak_rotations must have a value for each of {number} motions, NaN where it was"
                f" not measured, got {describe(peak_rotations)}"
            )
        if (peaks < 0).any() or np.isinf(peaks).any():
            raise ValueError(
                "peak_rotations must be at least 0, or NaN where they were not measured, got"
                f" {peaks[(peaks < 0) | np.isinf(peaks)][0]:g}"
            )
        # A block that overturned has none: it would be that of the floor.
        peaks = np.where(outcomes, np.nan, peaks)
    if samples is None:
        samples = _choose_samples(number)
    if type(samples) is not int or samples < _LEAST_SAMPLES or samples & (samples - 1):
        raise ValueError(
            f"samples must be a power of 2 from {_LEAST_SAMPLES} on, got {samples!r:.60}"
        )
    if type(seed) is not int or seed < 0:
        raise ValueError(f"seed must be a whole number from 0 on, got {seed!r:.60}")
    simulator = Simulator(
        gravity=_to_single("gravity", gravity, "m/s2", POSITIVE),
        inertia_ratio=_to_single("inertia_ratio", inertia_ratio, "", AT_LEAST_ONE),
        one_sided=as_flag("one_sided", one_sided),
        model=as_model(model),
        needs_peaks=peaks is not None,
    )
    return Campaign(
        suite, outcomes, names, places, peaks, simulator, make_prior(prior), samples, seed
    )


def _choose_samples(tests: int) -> int:
    """Choose how many blocks the sample has, a power of 2."""
    least, most = _USUAL_SAMPLES
    samples = most
    while samples > least and samples * tests > _USUAL_MOTIONS:
        samples //= 2
    return samples


def _to_single(name: str, value: object, unit: str, domain: Domain) -> float:
    """Convert to a single number that is allowed."""
    number = as_real(name, value, unit=unit)
    if number.shape:
        raise ValueError(f"{name} must be a single number, got {describe(value)}")
    check(name, number, domain)
    return float(number)


def _check_groups(
    groups: Sequence[object] | None, number: int
) -> tuple[tuple[str, ...], np.ndarray]:
    """Return the names of the groups, in order, and which of them each test belongs to."""
    # Each test is a group of its own.
    labels = range(number) if groups is None else groups
    is_sequence = isinstance(labels, Sequence | np.ndarray) and not isinstance(labels, str)
    if not is_sequence or len(labels) != number:
        raise ValueError(
            f"groups must have a name for each of {number} motions, got {describe(groups)}"
        )
    names, places = np.unique(np.array([str(label) for label in labels]), return_inverse=True)
    return tuple(names.tolist()), places.reshape(-1)


class CampaignFit(NamedTuple):
    """Populations fitted to parts of the tests of a campaign, and the sample that all share.

    Attributes
    ----------
    sample : BlockSample
    data : TestData
    searched : list of Searched
        For each part.
    posterior : Posterior
        Of the first part.
    effective_blocks : float
        Blocks on which probabilities by the first rest.
    """

    sample: BlockSample
    data: TestData
    searched: list[Searched]
    posterior: Posterior
    effective_blocks: float


def fit_parts(campaign: Campaign, parts: Sequence[np.ndarray]) -> CampaignFit:
    """Fit a population to each part of the tests, from one sample of blocks.

    The sample has blocks of the prior, then blocks where the populations of all parts are, and
    more of them until each population rests on enough. Where blocks are drawn changes how
    accurate an answer is, not what it would be with ever more of them.

    Parameters
    ----------
    campaign : Campaign
    parts : sequence of ndarray of bool, shape (tests,)
        Which tests count.
    """
    simulator = campaign.simulator
    prior = campaign.prior
    seed = campaign.seed
    widest = NormalComponent(
        np.asarray(prior.mean[:3]), np.diag(np.asarray(prior.width[:3])), 0.0
    )
    first_stage = campaign.samples // _FIRST_STAGE
    sample = draw_sample(simulator, campaign.suite, [widest], first_stage, seed)
    searched, data = _search_parts(campaign, sample, parts)
    # At first all populations need blocks of their own.
    poor = list(range(len(parts)))
    number = campaign.samples
    for turn in range(1, _MOST_ROUNDS + 1):
        covariance = _compute_covariance(campaign, sample, data, searched[0], parts[0])
        proposals = []
        for k in poor:
            # Fewer tests leave more uncertain. Second derivatives for each part would take
            # longer than all else.
            fewer = parts[0].sum() / max(parts[k].sum(), 1)
            proposals.append(propose_blocks(searched[k], fewer * covariance))
        sample = draw_sample(simulator, campaign.suite, proposals, number, seed + turn, sample)
        searched, data = _search_parts(campaign, sample, parts, searched)
        points = sample.points
        effective = [count_effective_blocks(end, points) for end in searched]
        poor = [k for k, blocks in enumerate(effective) if blocks < _ENOUGH_BLOCKS]
        if not poor:
            break
        number = first_stage
    posterior = sample_posterior(
        searched[0],
        _compute_covariance(campaign, sample, data, searched[0], parts[0]),
        prior,
        sample.points,
        data,
        campaign.pad(parts[0]),
        seed,
        grouped=campaign.grouped,
    )
    effective_blocks = count_effective_blocks(searched[0], sample.points)
    return CampaignFit(sample, data, searched, posterior, effective_blocks)


def _search_parts(
    campaign: Campaign,
    sample: BlockSample,
    parts: Sequence[np.ndarray],
    before: Sequence[Searched] = (),
) -> tuple[list[Searched], TestData]:
    """Search the populations that fit the parts of the tests, perhaps from earlier ones."""
    data = campaign.make_data(sample)
    points = sample.points
    searched = [
        search_population(
            campaign.prior,
            points,
            data,
            campaign.pad(part),
            grouped=campaign.grouped,
            start=before[k].free if before else None,
        )
        for k, part in show_progress(list(enumerate(parts)), "fits")
    ]
    return searched, data


def _compute_covariance(
    campaign: Campaign,
    sample: BlockSample,
    data: TestData,
    searched: Searched,
    part: np.ndarray,
) -> np.ndarray:
    """Compute the covariance of the free numbers of a population fitted to a part."""
    return compute_covariance(
        searched,
        campaign.prior,
        sample.points,
        data,
        campaign.pad(part),
        grouped=campaign.grouped,
    )
