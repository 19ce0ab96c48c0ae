"""As much model as a scene requires: the cheapest setting that keeps a tolerance."""

import functools
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..driven import TOLERANCES, DrivenScene, respond_within
from ..ground_motion import Harmonic, Pulse, Record
from ..host import Printed, format_fields
from ..resonance import Scene
from ..validation import (
    POSITIVE,
    Booleans,
    Integers,
    Number,
    Reals,
    as_real,
    check,
    check_concrete,
    check_kind,
    describe,
    is_traced,
)
from .model_errors import Answers, ModelError, model_error


@dataclass(frozen=True, repr=False)
class Setting(Printed):
    """Level of fidelity, precision and tolerance with which an answer is computed."""

    level: str  # linearized, nonlinear, pulsed, batch or adaptive
    bits: int
    rtol: float = 0.0  # of the batch

    def __str__(self) -> str:
        rtol = f" at rtol {self.rtol:g}" if self.rtol else ""
        return f"{self.level}{rtol} in float{self.bits}"


# From the cheapest on, as `measure_tradeoff` finds them: `choose` takes the first that is
# enough.
CLOSED = tuple(
    Setting(level, bits) for level in ("linearized", "nonlinear") for bits in (32, 64)
)
# The error of `pulsed_phase` at its default tolerance, as a change of the intensity.
_PULSED_SLIP = 1e-8


class Choice(Printed, eqx.Module):
    """The cheapest setting whose error is within a tolerance; see `choose`.

    Attributes
    ----------
    index : Array of int
        Index into `settings`.
    error : Array
        Predicted bound on the relative error of this setting.
    within_tolerance : Array of bool
        Whether `error` is within the tolerance. If not, the setting is the most accurate one.
    tolerance : float
        The relative tolerance.
    settings : tuple of Setting
        All settings that were compared, the cheapest first: level of fidelity, bits, and rtol
        of the batch.
    reasons : tuple of str
        For a single scene, the error that each simplification causes, in words.
    """

    index: Integers
    error: Reals
    within_tolerance: Booleans
    tolerance: float = eqx.field(static=True)
    settings: tuple[Setting, ...] = eqx.field(static=True)
    reasons: tuple[str, ...] = eqx.field(static=True)

    @property
    def setting(self) -> Setting:
        """The setting for a single scene.

        Raises
        ------
        ValueError
            If there are several scenes.
        """
        if jnp.ndim(self.index):
            raise ValueError(f"setting needs a single scene, got {jnp.shape(self.index)}")
        return self.settings[int(self.index)]

    def __str__(self) -> str:
        # A traced choice has no values to count or compare.
        if is_traced(self.index):
            return format_fields(self, index="", error="", within_tolerance="")
        if jnp.ndim(self.index):
            counts = np.bincount(np.ravel(self.index), minlength=len(self.settings))
            by_setting = zip(counts, self.settings, strict=True)
            lines = [f"{count:6} {setting}" for count, setting in by_setting if count]
            beyond = int(np.sum(~np.asarray(self.within_tolerance)))
            return "\n".join([*lines, f"{beyond:6} of them beyond {self.tolerance:g}"])
        verdict = f"{self.setting}: off by at most {float(self.error):.1e}"
        if not self.within_tolerance:
            verdict = f"no setting is within {self.tolerance:g}; the best is {verdict}"
        return "\n".join([verdict, *self.reasons])


def choose(
    scene: Scene | DrivenScene,
    tolerance: float,
    shape: type[Pulse] | None = None,
    duration: Number = 0.0,
) -> Choice:
    """Choose the cheapest level of fidelity, precision and `rtol` within a tolerance.

    Parameters
    ----------
    scene : Scene or DrivenScene
        Elementwise: every element gets a setting of its own.
    tolerance : float
        Allowed relative error. For a `Scene` it applies to the rotation ratio, the period and
        the critical intensity, for a `DrivenScene` to the peak rotation. A setting that
        predicts standing for a block that overturns is never within tolerance.
    shape : type, optional
        Shape of the pulses of a `Scene`, `Rectangular` or `HalfSine`. By default the pulses
        are instantaneous.
    duration : array_like, optional
        Duration of those pulses [s].

    Returns
    -------
    Choice

    Raises
    ------
    ValueError
        If an argument is not allowed.

    Notes
    -----
    The setting for a `Scene` follows from `model_error`, before anything is computed under
    pulses of finite duration. For a `DrivenScene` the motion is simulated by
    `respond_within`, which compares it with less accurate simulations. 64 bits are considered
    only if JAX is set to them; a `DrivenScene` keeps its own precision.

    Examples
    --------
    >>> import jax
    >>> import jaxrock as jr
    >>> wall = jr.Scene(jr.Block(half_width=0.4, slenderness=5.0), 0.7, 0.15)
    >>> print(jr.choose(wall, 0.01).setting)
    linearized in float32
    """
    check_concrete((scene, tolerance, shape, duration), "the choice depends on the answers")
    check("tolerance", as_real("tolerance", tolerance), POSITIVE)
    tolerance = float(tolerance)
    if isinstance(scene, DrivenScene):
        if shape is not None:
            raise ValueError(
                "shape must be left out for a DrivenScene, whose motion has a shape of its own"
            )
        return _choose_rtol(scene, tolerance)
    check_kind("scene", scene, Scene, DrivenScene)
    wide = jnp.result_type(float) == jnp.float64
    # Costs are computed in 64 bits where they are on offer, whatever the scene has.
    exact: Scene = (
        jax.tree.map(lambda leaf: jnp.asarray(leaf, float), scene) if wide else scene
    )
    predicted = model_error(exact, shape, duration)
    settings = tuple(setting for setting in CLOSED if wide or setting.bits == 32)
    errors = [
        _find_largest(predicted.total(setting.level, setting.bits)) for setting in settings
    ]
    if shape is not None:
        settings += (Setting("pulsed", 64 if wide else 32),)
        # Rounding to float32 is a slip of the intensity, too. Its cost, in proportion to the
        # slips, is that of `pulsed_phase`: another closed form need not be computed.
        slip = _PULSED_SLIP / float(jnp.finfo(jnp.float32).eps)
        errors.append(slip * _find_largest(predicted.rounding["nonlinear"][32]))
    table = jnp.stack(errors)
    keeps = table <= tolerance
    # The first that keeps the tolerance, element by element; the best where none does.
    index = jnp.where(keeps.any(axis=0), jnp.argmax(keeps, axis=0), jnp.argmin(table, axis=0))
    error = jnp.take_along_axis(table, index[None], axis=0)[0]
    reasons = () if index.ndim else _explain(predicted, shape)
    return Choice(index, error, keeps.any(axis=0), tolerance, settings, reasons)


def _find_largest(errors: Answers) -> Reals:
    """Find the largest of the three errors, element by element."""
    return functools.reduce(jnp.maximum, jax.tree.leaves(errors))


def _explain(predicted: ModelError, shape: type[Pulse] | None) -> tuple[str, ...]:
    """Say in sentences what each simplification of a single scene costs."""
    causes = {"linearizing": predicted.linearization}
    if shape is not None:
        causes["taking the pulses as instantaneous"] = predicted.duration
        causes["the uncertainty of that estimate"] = predicted.duration_bound
    causes["rounding to float32 (upper bound)"] = predicted.rounding["nonlinear"][32]
    lines: list[str] = []
    for cause, errors in causes.items():
        parts = (
            f"{'an unbounded error' if jnp.isinf(error) else f'{100 * float(error):.2g} %'}"
            f" of the {answer.replace('_', ' ')}"
            for answer, error in vars(errors).items()
        )
        lines.append(f"{cause} costs {', '.join(parts)}")
    return tuple(lines)


def _explain_estimate(error: float) -> str:
    """Say in a sentence what the error of a single driven scene was estimated from."""
    if np.isinf(error):
        return "a less accurate simulation diverges, perhaps since impacts amplify rounding"
    return "estimated from a less accurate simulation, which does not diverge"


def _choose_rtol(scene: DrivenScene, tolerance: float) -> Choice:
    """Choose the tolerance of the batch by a trial: no closed form predicts driven motion."""
    motion = scene.motion
    if not isinstance(motion, Pulse | Harmonic | Record):
        raise ValueError(
            f"motion must be a pulse, a Harmonic or a Record, got {describe(motion)}"
        )
    within = respond_within(scene.block, scene.restitution, motion, tolerance)
    bits = int(jnp.finfo(within.response.margin.dtype).bits)
    levels = np.array(TOLERANCES[bits])
    # Tolerances fall: the number of those above the cheapest is its place among them.
    index = jnp.asarray((np.asarray(within.cheapest)[..., None] < levels).sum(axis=-1))
    # The trial shows that a looser tolerance is good enough, but not by how much.
    error = jnp.where(within.cheapest > within.rtol, tolerance, within.error)
    return Choice(
        index,
        error,
        within.within_tolerance,
        tolerance,
        tuple(Setting("batch", bits, level) for level in levels.tolist()),
        () if index.ndim else (_explain_estimate(float(within.error)),),
    )
