"""Linear oscillators under acceleration that is linear between samples, solved exactly.

The equation in units of the time step h, of an oscillator that is at rest at the first sample:

    d'' + 2 c d' + x^2 d = -a,        x = 2 pi h / T,  c = zeta x,

with the displacement d relative to the ground over h^2 (Nigam and Jennings 1969,
doi:10.1785/BSSA0590020909). After each interval between two samples the oscillator has a
displacement and a velocity, from which it vibrates freely, in closed form: the motion is the
convolution of the samples with these vibrations.
"""

import numpy as np

from ..validation import AnyArray, choose_namespace

# Below this x the closed forms of the integrals over a step cancel; above it they lose at most
# a digit.
_SHORT = 2.0
# Eight nodes integrate a vibration over less than a third of its period without an error.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
_NODES = 0.5 + 0.5 * _NODES  # from 0 to 1
_WEIGHTS = 0.5 * _WEIGHTS


def compute_absolute_accelerations(
    samples: AnyArray, x: AnyArray, damping: AnyArray, weights: AnyArray, steps: int
) -> AnyArray:
    """Compute the weighted sum of the absolute accelerations of oscillators, from rest on.

    Parameters
    ----------
    samples : Array, shape (..., samples)
        Acceleration of the ground, linear between samples; it is 0 behind the last one.
    x, damping, weights : Array, shape (..., oscillators)
        2 pi times time step over period, damping ratio below 1, factor in the sum [-]. They
        have as many axes as the samples.
    steps : int
        Number of steps of the answer, at least as many as there are between the samples.

    Returns
    -------
    Array, shape (..., steps + 1)
        At the ends of the steps, in the unit of the samples.
    """
    library = choose_namespace((samples, x, damping, weights))
    response = _respond_to_step(x[..., None], damping[..., None], steps)
    response = (weights[..., None, :, None] * response).sum(axis=-2)
    pairs = library.stack([samples[..., :-1], samples[..., 1:]], axis=-2)
    # The length is a power of two, and long enough that nothing wraps around to the beginning.
    size = 1 << (2 * steps - 1).bit_length()
    spectrum = library.fft.rfft(pairs, n=size) * library.fft.rfft(response, n=size)
    moved = library.fft.irfft(spectrum.sum(axis=-2), n=size)[..., :steps]
    return library.concatenate([library.zeros_like(moved[..., :1]), moved], axis=-1)


def _respond_to_step(x: AnyArray, damping: AnyArray, steps: int) -> AnyArray:
    """Compute absolute accelerations after an interval in which the ground moves.

    Returns
    -------
    Array, shape (..., 2, oscillators, steps)
        Accelerations at the ends of the steps, for a unit sample at the beginning and one at
        the end of the first step.
    """
    library = choose_namespace((x, damping))
    decay = damping * x
    rate = x * library.sqrt((1 - damping) * (1 + damping))

    def vibrate(times: np.ndarray) -> tuple[AnyArray, AnyArray]:
        times = times.astype(x.dtype).reshape(*[1] * (x.ndim - 1), -1)
        decayed = library.exp(-decay * times)
        return decayed * library.cos(rate * times), decayed * library.sin(rate * times) / rate

    # The response to an impulse after one step, its first integral, and its second integral.
    cosine, impulse = vibrate(np.ones(1))
    _, inside = vibrate(_NODES)
    integrals = inside @ np.stack([_WEIGHTS, _WEIGHTS * (1 - _NODES)], axis=1).astype(x.dtype)
    is_short = x < _SHORT
    square = library.where(is_short, 1, x * x)
    step = (1 - cosine - decay * impulse) / square
    step = library.where(is_short, integrals[..., :1], step)
    ramp = (1 - impulse - 2 * decay * step) / square
    ramp = library.where(is_short, integrals[..., 1:], ramp)
    cosine, sine = vibrate(np.arange(steps))
    responses = []
    for displacement, velocity in ((ramp - step, step - impulse), (-ramp, -step)):
        acceleration = -(x * x * displacement + 2 * decay * velocity)
        change = -(x * x * velocity + decay * acceleration)
        responses.append(acceleration * cosine + change * sine)
    return library.stack(responses, axis=-3)
