"""The quantities of the library again, in mpmath, from the equations as first written.

Nothing here is rearranged for accuracy: Eqs. 6, 7 and 12 with cosh of artanh, the
nonlinear peak from the cosine form of the energy, its duration from Legendre's
integrals. Cancellation is met with digits instead.
"""

import mpmath as mp


def half_diagonal(b, slenderness):
    return b * mp.sqrt(1 + slenderness**2)


def frequency(b, slenderness, gravity):
    return mp.sqrt(3 * gravity / (4 * half_diagonal(b, slenderness)))


def critical_angle(slenderness):
    return mp.atan(1 / slenderness)


def launch_velocity(b, slenderness, gravity, intensity):
    """Eqs. 2 and 3, through the angular acceleration that they name."""
    acceleration = mp.mpf(3) / 4 * b / ((slenderness * b) ** 2 + b**2) * gravity
    return slenderness * acceleration * intensity / gravity


class Linearized:
    @staticmethod
    def critical_velocity(b, slenderness, gravity):
        return critical_angle(slenderness) * frequency(b, slenderness, gravity)

    @staticmethod
    def peak_rotation(b, slenderness, gravity, velocity):
        p = frequency(b, slenderness, gravity)
        angle = critical_angle(slenderness)
        argument = mp.atanh(velocity / (angle * p))
        return angle * (1 - mp.cosh(argument)) + velocity / p * mp.sinh(argument)

    @staticmethod
    def half_cycle_duration(b, slenderness, gravity, velocity):
        p = frequency(b, slenderness, gravity)
        angle = critical_angle(slenderness)
        return 2 / p * mp.atanh(velocity / (angle * p))

    @staticmethod
    def motion(b, slenderness, gravity, velocity, time):
        """Eq. 5: rotation and velocity."""
        p = frequency(b, slenderness, gravity)
        angle = critical_angle(slenderness)
        sinh = mp.sinh(p * time)
        cosh = mp.cosh(p * time)
        return angle * (1 - cosh) + velocity / p * sinh, -angle * p * sinh + velocity * cosh


class Nonlinear:
    @staticmethod
    def critical_velocity(b, slenderness, gravity):
        p = frequency(b, slenderness, gravity)
        angle = critical_angle(slenderness)
        return p * mp.sqrt(2 * (1 - mp.cos(angle)))

    @staticmethod
    def peak_rotation(b, slenderness, gravity, velocity):
        p = frequency(b, slenderness, gravity)
        angle = critical_angle(slenderness)
        return angle - mp.acos(mp.cos(angle) + velocity**2 / (2 * p**2))

    @classmethod
    def half_cycle_duration(cls, b, slenderness, gravity, velocity):
        """The block as a pendulum of frequency p that hangs at rotation alpha_c - pi."""
        with mp.extradps(40):
            return cls._half_cycle_duration(b, slenderness, gravity, velocity)

    @staticmethod
    def _half_cycle_duration(b, slenderness, gravity, velocity):
        p = frequency(b, slenderness, gravity)
        angle = critical_angle(slenderness)
        modulus = mp.cos(angle / 2) ** 2 + velocity**2 / (4 * p**2)
        launch = mp.asin(mp.cos(angle / 2) / mp.sqrt(modulus))
        swing = mp.ellipk(modulus) - mp.ellipf(launch, modulus)
        return mp.sign(velocity) * 2 / p * swing  # odd, so that it has a slope at 0

    @classmethod
    def motion(cls, b, slenderness, gravity, velocity, time):
        """The same pendulum, at a time counted from its lowest point."""
        p = frequency(b, slenderness, gravity)
        angle = critical_angle(slenderness)
        modulus = mp.cos(angle / 2) ** 2 + velocity**2 / (4 * p**2)
        launch = mp.asin(mp.cos(angle / 2) / mp.sqrt(modulus))
        phase = mp.ellipf(launch, modulus) + p * time
        sine = mp.sqrt(modulus) * mp.re(mp.ellipfun("sn", phase, m=modulus))
        cosine = mp.re(mp.ellipfun("dn", phase, m=modulus))
        rate = 2 * p * mp.sqrt(modulus) * mp.re(mp.ellipfun("cn", phase, m=modulus))
        return angle - mp.pi + 2 * mp.atan2(sine, cosine), rate


def half_cycle_velocity(b, slenderness, gravity, restitution, intensity, count):
    """Eq. 8, its recursion; the limit of Eq. 10 where count is inf."""
    first = launch_velocity(b, slenderness, gravity, intensity)
    if count == mp.inf:
        return first / (1 - restitution)
    velocity = first
    for _ in range(int(count) - 1):
        velocity = restitution * velocity + first
    return velocity


def peak_amplification(model, b, slenderness, gravity, velocity, growth):
    block = b, slenderness, gravity
    with mp.extradps(60):
        higher = model.peak_rotation(*block, velocity * (1 + growth))
        return higher / model.peak_rotation(*block, velocity)


def stabilized(name):
    """A function (model, b, slenderness, gravity, restitution, intensity) -> value."""

    def stabilized_period(model, *block, velocity, first):
        return 2 * model.half_cycle_duration(*block, velocity)

    def stabilized_rotation(model, *block, velocity, first):
        return model.peak_rotation(*block, velocity)

    def rotation_ratio(model, *block, velocity, first):
        return model.peak_rotation(*block, velocity) / critical_angle(block[1])

    def amplification(model, *block, velocity, first):
        return peak_amplification(model, *block, first, velocity / first - 1)

    def overturning_margin(model, *block, velocity, first):
        return 1 - (velocity / model.critical_velocity(*block)) ** 2

    definition = locals()[name]

    def function(model, b, slenderness, gravity, restitution, intensity):
        first = launch_velocity(b, slenderness, gravity, intensity)
        velocity = first / (1 - restitution)
        return definition(model, b, slenderness, gravity, velocity=velocity, first=first)

    return function


def critical_intensity(model, b, slenderness, gravity, restitution, count):
    critical = model.critical_velocity(b, slenderness, gravity)
    if count == mp.inf:
        return (
            critical * (1 - restitution) / launch_velocity(b, slenderness, gravity, mp.mpf(1))
        )
    return critical / half_cycle_velocity(
        b, slenderness, gravity, restitution, mp.mpf(1), count
    )


def _at_intensity(model, count, intensity, around, scene_of):
    """Where the critical intensity is that of the scene; sought on logarithms."""

    def excess(logarithm):
        return mp.log(
            critical_intensity(model, *scene_of(mp.exp(logarithm)), count) / intensity
        )

    tolerance = mp.mpf(10) ** (-1.6 * mp.mp.dps)
    return mp.exp(mp.findroot(excess, (mp.log(around), mp.log(2 * around)), tol=tolerance))


def critical_width(model, b, slenderness, gravity, restitution, intensity, count):
    def scene_of(half_width):
        return half_width, slenderness, gravity, restitution

    return 2 * _at_intensity(model, count, intensity, mp.mpf(1), scene_of)


def critical_slenderness(model, b, slenderness, gravity, restitution, intensity, count):
    def scene_of(slenderness):
        return b, slenderness, gravity, restitution

    return _at_intensity(model, count, intensity, mp.mpf(1), scene_of)


def critical_restitution(model, b, slenderness, gravity, restitution, intensity, count):
    single = critical_intensity(model, b, slenderness, gravity, mp.mpf(0), 1)
    if count == mp.inf:
        return 1 - intensity / single

    def excess(c):
        return sum(c**k for k in range(count)) - single / intensity

    return mp.findroot(excess, mp.mpf(1), tol=mp.mpf(10) ** (-1.6 * mp.mp.dps))
