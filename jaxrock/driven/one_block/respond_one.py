"""One block by an adaptive integrator: `respond`, its checks and its defaults."""

import contextlib

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ...block import Block
from ...ground_motion import Motion, Record, Suite
from ...host import Status
from ...resonance import ModelLike, Nonlinear, as_model
from ...validation import (
    Number,
    as_array,
    as_name,
    check_kind,
    describe,
    is_traced,
    unify_precision,
)
from ..scene import Driven
from .event_loop import follow_concrete, follow_driven_jitted
from .response import Response

_SOLVERS = "Tsit5", "Dopri5", "Dopri8"
# Impacts that are listed outside of transformations; a motion with more is integrated again.
_MAX_IMPACTS = 2048


def respond(  # noqa: PLR0913
    block: Block,
    restitution: Number,
    motion: Motion,
    duration: Number | None = None,
    *,
    rotation: Number = 0.0,
    velocity: Number = 0.0,
    rtol: float | None = None,
    atol: float | None = None,
    solver: str = "Tsit5",
    model: ModelLike = Nonlinear(),
    max_impacts: int = 64,
) -> Response:
    """Compute the response of one block to a ground motion, through every impact.

    Parameters
    ----------
    block : Block
        One block; `respond_batch` and `jax.vmap` take many.
    restitution : float
        C, velocity after an impact over velocity before it [-], between 0 and 1.
    motion : Motion
        A pulse, a `Harmonic` or a `Record`; for free rocking a record of zeros,
        ``Record([0.0, 0.0], 0.01)``, and a duration.
    duration : float, optional
        Simulated time [s], greater than 0; by default to the end of the motion.
    rotation, velocity : float, optional
        Initial rotation [rad] and angular velocity [rad/s]; at rest by default.
    rtol, atol : float, optional
        Relative tolerance of each integration step, by default 1e-8 (1e-5 in float32), and
        absolute tolerance in rad and rad/s, by default 1e-9 times the relative one. So small
        bounces are integrated as accurately as large ones.
    solver : str
        Of diffrax: "Tsit5", "Dopri5" or "Dopri8". On records, where steps end at every
        sample, "Dopri8" with a loose `rtol` is more accurate.
    model : Nonlinear or Linearized, or their names
        Equation of motion: `Nonlinear` by default, while closed forms such as
        `rotation_ratio` are `Linearized` by default. `Linearized` is here the equation of the
        literature. Its limit for short pulses differs from Eq. 2 by a factor of cos(alpha_c).
    max_impacts : int
        Length of the lists of impacts under `jit`, `vmap` and derivatives; 0 for no lists.
        `history` needs the lists. Outside of transformations all impacts are listed.

    Returns
    -------
    Response

    Raises
    ------
    ValueError
        If a concrete argument is out of its range or not scalar, or if the precision cannot
        deliver the tolerance. Traced values out of range give NaN and `Status.INVALID`.

    Notes
    -----
    Derivatives exist in both modes. A first derivative costs one forward derivative for each
    perturbed parameter, a second derivative as much again for each of these. With respect to a
    record of more than 64 samples, forward mode costs one for each direction. Reverse mode is a
    sweep backwards along the motion, by `respond_batch`; it exists for the peak rotation, the
    final rotation and velocity, and the margin. The first call of a second derivative takes two
    to three times as long as the first call of a first derivative. Second derivatives are
    forward over either mode, ``jax.jacfwd(jax.grad(f))``.

    Results may have a kink where two of these events coincide: the start of the input, its end,
    a sample of a record, an impact, and the end of the duration. The derivative is then
    one-sided:

    1. If the end of the duration coincides with another event, it is the derivative for a
       shorter duration. Under a pulse that ends at 0.8 s and with ``duration=0.8``, the pulse
       acts until the end.
    2. If the end of the input coincides with another event, it is the derivative for a later
       end of the input.
    3. If the input starts at time 0, it is the derivative for a later start.
    4. If an impact coincides with one of these times, it is the derivative for one of the two
       orders, the same order for all results.
    5. If a peak rotation or an extreme force is reached twice, it is the derivative at the
       first time. Each extreme is differentiated at the moment at which it is reached.
    6. If C is 0, the first derivative is for a larger C. If a block begins at rest and is
       lifted at once, it is the derivative for a rotation or velocity to the side that is
       lifted.

    Two checks of JAX would raise errors although nothing is wrong: `jax.debug_nans`, since
    values that do not exist are NaN, and `jax.checking_leaks`, since diffrax keeps traced
    values. Outside of transformations `respond` switches both off while it computes. If you
    call it under `jit`, switch them off yourself.

    Examples
    --------
    >>> import jaxrock as jr
    >>> block = jr.Block(half_width=0.2, slenderness=5.0)
    >>> pulse = jr.Sine(amplitude=2.5, duration=0.8)
    >>> response = jr.respond(block, 0.9, pulse, duration=5.0, rtol=1e-5)
    >>> print(bool(response.overturned), int(response.status))
    False 0
    """
    check_kind("block", block, Block)
    hint = "; respond_batch takes suites" if isinstance(motion, Suite) else ""
    check_kind("motion", motion, Motion, hint=hint)
    duration = motion.end if duration is None else duration
    driven = Driven(block, restitution, motion, duration, rotation, velocity)
    _check_scalar(driven)
    driven = unify_precision(driven)
    dtype = driven.restitution.dtype
    rtol, atol = _choose_tolerances(rtol, atol, dtype)
    solver = as_name("solver", solver, _SOLVERS)
    if not isinstance(max_impacts, int | np.integer) or max_impacts < 0:
        raise ValueError(
            f"max_impacts must be a whole number from 0 on, got {describe(max_impacts)}"
        )
    # Tolerances are arrays: another value compiles nothing anew.
    settings = {
        "rtol": np.asarray(rtol, dtype),
        "atol": np.asarray(atol, dtype),
        "model": as_model(model),
        "method": solver,
    }
    # Motions of many shapes share one program; the response keeps the motion as it is.
    bucketed = driven.bucketed()
    concrete = not is_traced(driven)
    runs_on_cpu = concrete and jax.default_backend() == "cpu"
    follow = follow_concrete if runs_on_cpu else follow_driven_jitted
    max_impacts = _MAX_IMPACTS if concrete else max_impacts
    with contextlib.ExitStack() as stack:
        # Only checks that are on are switched off: each change of the configuration compiles
        # anew.
        if jax.config.jax_debug_nans:
            stack.enter_context(jax.debug_nans(False))
        if jax.config.jax_check_tracer_leaks:
            stack.enter_context(jax.check_tracer_leaks(False))
        response = follow(bucketed, **settings, max_impacts=max_impacts).response
        # This is rare: each length of the lists is a program of its own.
        while concrete and int(response.status) == Status.LIST_FULL:
            max_impacts *= 32
            response = follow(bucketed, **settings, max_impacts=max_impacts).response
    response = eqx.tree_at(lambda r: r.scene, response, driven)
    return _cut_lists(response) if concrete else response


def _check_scalar(driven: Driven) -> None:
    """Check that everything is scalar except the samples of a record."""
    motion = driven.motion
    samples = (motion.acceleration, motion.vertical) if isinstance(motion, Record) else ()
    for name, tree in vars(driven).items():
        for leaf in jax.tree.leaves(tree):
            if jnp.ndim(leaf) != any(leaf is rows for rows in samples):
                raise ValueError(f"{name} must be scalar here; respond_batch takes arrays")


def _choose_tolerances(
    rtol: float | None, atol: float | None, dtype: np.dtype
) -> tuple[float, float]:
    """Check the tolerances, and choose the ones that are not given."""
    # No step is accurate to less than some units in the last place: the control would make
    # steps shorter and shorter.
    least = 20 * float(jnp.finfo(dtype).eps)
    rtol = (1e-8 if dtype == np.float64 else 1e-5) if rtol is None else float(rtol)
    atol = 1e-9 * rtol if atol is None else float(atol)
    if not least <= rtol < 1:
        raise ValueError(
            f"rtol must be less than 1 and at least {least:.1g}, which is what {dtype}"
            f" can deliver, got {rtol:g}"
        )
    if not 0 <= atol < 1:
        raise ValueError(f"atol must be at least 0 and less than 1, got {atol:g}")
    return rtol, atol


def _cut_lists(response: Response) -> Response:
    """Cut the lists of a concrete response to the right length."""

    def get_lists(r: Response) -> tuple:
        return r.impact_times, r.impact_velocities, *jax.tree.leaves(r.events)

    events = int(np.isfinite(response.events.time).sum())
    sizes = [int(response.impacts)] * 2 + [events] * 4
    # NumPy compiles nothing.
    cut = [
        as_array(np.asarray(rows)[:n])
        for rows, n in zip(get_lists(response), sizes, strict=True)
    ]
    return eqx.tree_at(get_lists, response, tuple(cut))
