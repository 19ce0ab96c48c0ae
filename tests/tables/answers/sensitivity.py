"""What answers depend on: derivatives, ranges, samples."""

from scenes import record, suite

import jaxrock as jr

from .half_cycle_map import spread
from .table import group, list_fields

WALL = jr.Scene(jr.Block(0.4, 5.0), restitution=0.7, intensity=0.15)
UNCERTAIN = jr.Uncertain(
    {"half_width": 0.03, "restitution": 0.02, "intensity": 0.05}, samples=256, seed=2
)
OF_BARS = "names low high at_low at_high value"


@group("sensitivity/closed", 1e-11)
def differentiate_closed():
    found = jr.sensitivities(jr.rotation_ratio, WALL, sides=True)
    yield from list_fields(found, "names at value gradient elasticity", "sides/")
    scenes = jr.Scene(jr.Block(spread(0.2, 0.6, 1), 5.0), 0.7, 0.15)
    value, slopes = jr.value_and_slopes(jr.rotation_ratio)(scenes)
    yield "value_and_slopes/value", value
    yield "value_and_slopes/half_width", slopes.block.half_width
    yield "value_and_slopes/restitution", slopes.restitution


@group("sensitivity/tornado", by_default=True)
def vary_parameters():
    ranges = {"slenderness": (4.0, 6.0), "restitution": (0.6, 0.8), "intensity": (0.1, 0.5)}
    bars = jr.tornado(jr.rotation_ratio, WALL, ranges)
    yield from list_fields(bars, OF_BARS, "shape/")
    bars = jr.tornado(jr.rotation_ratio, WALL, {"width": (0.7, 0.9), "height": (3.0, 5.0)})
    yield from list_fields(bars, OF_BARS, "sides/")


@group("sensitivity/moments", 1e-10)
def propagate_uncertainty():
    found = jr.sensitivity.propagate(jr.rotation_ratio, WALL, UNCERTAIN)
    names = (
        "first_order_mean first_order_standard_deviation mean standard_deviation"
        " within_tolerance mean_error standard_deviation_error left_out"
    )
    yield from list_fields(found, names)
    yield "variance_fractions", list(found.variance_fractions.values())


@group("sensitivity/draws", 1e-11, by_default=True)
def draw_blocks():
    """By their seeds."""
    block = jr.Block(0.25, 4.0)
    cases = {
        "half_width slenderness": {"width": 0.1, "height": 0.05, "restitution": 0.08},
        "half_width gravity": {"half_width": 0.1, "gravity": 0.01},
        "slenderness inertia_ratio": {"slenderness": 0.05, "inertia_ratio": 0.05},
    }
    for names, coefficients in cases.items():
        draws = jr.Uncertain(coefficients, samples=8, seed=3).draw(block, 0.8)
        prefix = f"{names.replace(' ', '_and_')}/"
        yield prefix + "restitution", draws.restitution
        yield from list_fields(draws.block, names, prefix)
    measured = {"critical_angle": 0.2, "frequency_parameter": 0.05, "restitution": 0.08}
    correlations = {("critical_angle", "restitution"): 0.4}
    uncertain = jr.Uncertain(measured, correlations=correlations, samples=8, seed=3)
    draws = uncertain.draw(block, 0.8)
    yield from list_fields(draws, "restitution normal", "correlated/")
    yield from list_fields(draws.block, "half_width slenderness", "correlated/")
    floor = jr.Uncertain({"floor_period": 0.2, "floor_damping": 0.3}, samples=8)
    draws = floor.draw(block, 0.8, on_floor=True)
    yield from list_fields(draws.floor, "period damping", "floor/")


@group("sensitivity/driven_tornado", 1e-8)
def vary_driven_parameters():
    ranges = {
        "width": (0.7, 0.9),
        "height": (3.5, 4.5),
        "restitution": (0.8, 0.9),
        "amplitude": (2.8, 3.2),
        "duration": (0.4, 0.6),
    }
    block = jr.Block(0.4, 5.0)
    for answer in ("rotation_ratio", "peak_rotation", "margin"):
        bars = jr.sensitivity.driven_tornado(
            block, 0.85, jr.Sine(3.0, 0.5), ranges, answer=answer
        )
        yield from list_fields(bars, OF_BARS, f"{answer}/")
    ranges = {
        "restitution": (0.6, 0.7),
        "factor": (0.8 / 1.1, 1.2 / 1.1),
        "slenderness": (4.5, 5.5),
    }
    bars = jr.sensitivity.driven_tornado(block, 0.7, record().scaled(1.1), ranges)
    yield from list_fields(bars, OF_BARS, "record/")


@group("sensitivity/outcome_probabilities", 1e-9)
def count_outcomes():
    names = (
        "outcomes probability low high by_record answers sources first total first_error"
        " total_error by_median by_median_error"
    )
    coefficients = {"width": 0.1, "restitution": 0.05, "factor": 0.4}
    uncertain = jr.Uncertain(coefficients, samples=64)
    block = jr.Block.from_size(width=0.2, height=0.8)
    found = jr.sensitivity.outcome_probabilities(block, 0.7, suite(), uncertain)
    yield from list_fields(found, names)
    yield "peak", found.peak[:, ::8], 1e-7
