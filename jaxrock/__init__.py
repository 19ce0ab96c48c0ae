"""Rocking of rigid blocks on JAX: resonance spectra, sensitivities, inverse design.

Unless they say otherwise, functions are elementwise: arguments are numbers or arrays that
broadcast against each other. Answers have the broadcast shape, ``(...)`` in the docstrings.
Everything is in SI units and radians. A concrete argument out of range raises `ValueError`. A
traced one gives NaN, with derivative zero.

Two models describe the motion, `Linearized` and `Nonlinear`. Functions that need one take
``model=``: ``Linearized()``, ``Nonlinear()``, "linearized" or "nonlinear". By default the
closed forms (half-cycle map, limits, critical intensities, pulse trains) are linearized and
the equation of driven motion is nonlinear, as in the paper: C. Casapulla, *On the Resonance
Conditions of Rigid Rocking Blocks*, whose equations and figures the docstrings cite.

The functions listed here are enough for most work. Result classes and further tools are in the
packages: `resonance`, `ground_motion`, `driven`, `steady`, `overturning`, `sensitivity`,
`calibration`, `accuracy`, `grids`, `spectra`, `risk`, `plot`, `reports`.
``jaxrock.__version__`` is the version.

JAX uses threads, which do not survive `os.fork`: a forked process can hang at its first
computation. Start parallel processes with "spawn" or "forkserver", as in
``multiprocessing.get_context("spawn").Pool()``.
"""

import difflib
import importlib.metadata
from pathlib import Path

import lazy_loader

# A name listed in `__init__.pyi` is imported when it is used first: JAX takes a second.
_find, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


_MOVED = {
    "Still": "now a record of zeros, Record([0.0, 0.0], 0.01)",
    "dynamics": "divided into jaxrock.driven and jaxrock.steady",  # since 0.3.0
    "critical_duration": 'now overturning_boundaries(along="duration")',
    "critical_factor": 'now overturning_boundaries(along="factor")',
    "overturning_spectrum": "now overturning_map(amplitude_ratio=...)",
    "pulsed_next_velocity": "the next landing of respond(..., velocity=)",
    "survival_windows": 'now overturning_boundaries(along="factor").windows',
    "Oscillator": "written out on the page of the paper",
    "damping_from_decay": "-ln(B) / pi",
    "equivalent_damping_as_printed": "now resonance.equivalent_damping(as_printed=True)",
    "timing_costs": "written out in the notebook on inverse design",
    "local_dependence": "now derivatives_within(...)",
    "DrivenScene": "now a tuple (block, restitution, motion)",
}


def __getattr__(name: str) -> object:
    if name == "__version__":
        return importlib.metadata.version(__name__)
    try:
        return _find(name)
    except AttributeError:
        if name in __all__:  # of the inside, while it is imported
            raise
    place = _MOVED.get(name) or _find_place(name)
    near = difflib.get_close_matches(name, __all__, 1)
    hint = f"; it is {place}" if place else f"; did you mean {near[0]!r}?" if near else ""
    raise AttributeError(f"jaxrock has no {name!r}{hint}")


def _find_place(name: str) -> str | None:
    """Find the package that lists a name; its face is read, since importing it takes long."""
    for face in sorted(Path(__file__).parent.glob("*/__init__.py")):
        package = face.parent.name
        if package in __all__ and f'"{name}"' in face.read_text(encoding="utf-8"):
            return f"jaxrock.{package}.{name}"
    return None
