"""A sample of blocks from which all populations in question can be weighed, and its outcomes.

Scrambled Sobol points: first of the prior, then of the populations that fit the tests. Points of
both stages count, each by the density of the mixture that it comes from (Owen
and Zhou 2000, 10.1080/01621459.2000.10473909).
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np
from scipy.special import expit, logsumexp

from ...block import Block
from ...driven import Batch, follow_batch, require_complete
from ...ground_motion import Suite
from ...host import count_work
from ...resonance import RockingModel
from ...sensitivity import draw_normal_numbers
from ...validation import as_array
from .likelihood import Points

# Motions that are simulated at once: so many that a batch is efficient, and so few that a bar
# moves.
_AT_ONCE = 2**17
# Blocks with a larger critical angle do not count: they slide rather than rock [rad].
_LARGEST_ANGLE = 1.2
# A rotation that counts as none, so that it has a logarithm [rad].
PEAK_FLOOR = 1e-4


class NormalComponent(NamedTuple):
    """A normal distribution of coordinates that points are drawn from, and how many are.

    Attributes
    ----------
    mean : ndarray, shape (3,)
    factor : ndarray, shape (3, 3)
        Lower triangle of Cholesky of the covariance.
    number : float
        Points that come from it, on average.
    """

    mean: np.ndarray
    factor: np.ndarray
    number: float


class BlockSample(NamedTuple):
    """A sample of blocks, and what they do in the tests.

    Attributes
    ----------
    coordinates : ndarray, shape (blocks, 3)
    components : tuple of NormalComponent
        Where they were drawn from.
    overturned : ndarray of bool, shape (tests, blocks)
    peaks : ndarray of float32, shape (tests, blocks), or None
        Peak rotations [rad], if they are needed.
    """

    coordinates: np.ndarray
    components: tuple[NormalComponent, ...]
    overturned: np.ndarray
    peaks: np.ndarray | None

    @property
    def points(self) -> Points:
        """The blocks and the density with which they were drawn."""
        log_density = _compute_log_density(self.coordinates, self.components)
        # A block that no population has: it does not count.
        log_density[self.coordinates[:, 0] > np.log(_LARGEST_ANGLE)] = np.inf
        return Points(as_array(self.coordinates), as_array(log_density))


class Simulator(NamedTuple):
    """A way to simulate blocks of any coordinates.

    Attributes
    ----------
    gravity, inertia_ratio : float
        [m/s2], [-]
    one_sided : bool
        Whether blocks stand against a wall.
    model : Nonlinear or Linearized
    needs_peaks : bool
        Whether peak rotations are kept.
    """

    gravity: float
    inertia_ratio: float
    one_sided: bool
    model: RockingModel
    needs_peaks: bool

    def make_blocks(self, coordinates: np.ndarray) -> tuple[Block, np.ndarray]:
        """Make the blocks of coordinates, and their restitutions, in NumPy."""
        angle = np.minimum(np.exp(coordinates[:, 0]), _LARGEST_ANGLE)
        frequency_parameter = np.exp(coordinates[:, 1])
        half_diagonal = self.gravity / (self.inertia_ratio * frequency_parameter**2)
        sizes = (half_diagonal * np.sin(angle), 1 / np.tan(angle))
        block = Block(*sizes, self.gravity, self.inertia_ratio, one_sided=self.one_sided)
        leaves = (*sizes, np.asarray(self.gravity), np.asarray(self.inertia_ratio))
        # A block moves its numbers to the device; the batch wants them in NumPy.
        on_host = jax.tree.unflatten(jax.tree.structure(block), leaves)
        return on_host, expit(coordinates[:, 2])

    def simulate(
        self, coordinates: np.ndarray, suite: Suite
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """Simulate blocks under the motions of a suite.

        Returns
        -------
        overturned : ndarray of bool, shape (records, blocks)
        peaks : ndarray of float32, shape (records, blocks), or None

        Raises
        ------
        ValueError
            If an integration does not finish; the message names the motion.
        """
        # In single precision, which is twice as fast. Of 250,880 motions on shaking tables 0.16 %
        # end otherwise; overturning is 0.02 % more frequent.
        single = jax.tree.map(
            lambda leaf: np.asarray(leaf, np.float32), (self.make_blocks(coordinates), suite)
        )
        (blocks, restitution), suite = single
        step = max(_AT_ONCE // len(suite), 1)
        outcomes: list[np.ndarray] = []
        peaks: list[np.ndarray] = []
        ground = Batch.of(*_select(blocks, restitution, slice(0, 1)), suite, axes=1).ground
        with count_work("blocks under all motions", len(restitution) * len(suite)):
            for k in range(0, len(restitution), step):
                part = _select(blocks, restitution, slice(k, k + step))
                response = follow_batch(Batch.of(*part, ground), self.model)
                require_complete(np.asarray(response.complete), record=suite.names, block=None)
                outcomes.append(np.asarray(response.overturned))
                if self.needs_peaks:
                    peaks.append(np.asarray(response.peak_rotation, np.float32))
        overturned = np.concatenate(outcomes, axis=1)
        return overturned, np.concatenate(peaks, axis=1) if self.needs_peaks else None


def _select(block: Block, restitution: np.ndarray, part: slice) -> tuple[Block, np.ndarray]:
    """Select some blocks along their axis; single numbers stay."""
    return jax.tree.map(
        lambda leaf: leaf[part] if np.ndim(leaf) else leaf, (block, restitution)
    )


def draw_sample(
    simulator: Simulator,
    suite: Suite,
    components: Sequence[NormalComponent],
    number: int,
    seed: int,
    before: BlockSample | None = None,
) -> BlockSample:
    """Draw a sample of blocks from normal distributions, in equal parts, and simulate them.

    Parameters
    ----------
    simulator : Simulator
    suite : Suite
        The motions of the tests.
    components : sequence of NormalComponent
        Their numbers are replaced by those that are drawn.
    number : int
        Points, a power of 2.
    seed : int
        Of the scrambling of the Sobol points.
    before : BlockSample, optional
        A sample to which these are added.
    """
    normal = draw_normal_numbers(4, number, seed)
    # The fourth dimension says which component a point belongs to, for as many each.
    places = np.argsort(np.argsort(normal[:, 3])) * len(components) // number
    means = np.stack([component.mean for component in components])
    factors = np.stack([component.factor for component in components])
    coordinates = means[places] + np.einsum("bij,bj->bi", factors[places], normal[:, :3])
    overturned, peaks = simulator.simulate(coordinates, suite)
    counted = tuple(
        component._replace(number=number / len(components)) for component in components
    )
    if before is None:
        return BlockSample(coordinates, counted, overturned, peaks)
    if peaks is not None and before.peaks is not None:
        peaks = np.concatenate([before.peaks, peaks], axis=1)
    return BlockSample(
        np.concatenate([before.coordinates, coordinates]),
        (*before.components, *counted),
        np.concatenate([before.overturned, overturned], axis=1),
        peaks,
    )


def _compute_log_density(
    coordinates: np.ndarray, components: Sequence[NormalComponent]
) -> np.ndarray:
    """Compute the logarithm of the density of a mixture, up to a constant, (blocks,)."""
    terms = []
    for component in components:
        standard = np.linalg.solve(component.factor, (coordinates - component.mean).T)
        log_volume = np.log(np.diagonal(component.factor)).sum()
        log_factor = np.log(component.number) - log_volume
        terms.append(log_factor - 0.5 * np.sum(standard**2, axis=0))
    return np.asarray(logsumexp(terms, axis=0))
