"""The command about tests that overturned or stood: a calibrated model, and its scores."""

import math
from pathlib import Path
from typing import TYPE_CHECKING

import jax
import numpy as np

from ..block import RECTANGLE_INERTIA_RATIO, Block
from ..calibration import OutcomeFit, Outcomes, check_campaign, fit_and_score, read_tests
from ..host import announce, format_table, write_whole
from ..tables import write_csv
from .answers import Answer, describe_options, list_rows, save_picture
from .motion_options import put_on_floor
from .options import Count, FileOutput, Folder, ModelName, SizeOptions, refuse

if TYPE_CHECKING:
    import xarray

_FILES = (
    "validation.nc",
    "tests.csv",
    "scores.csv",
    "population.csv",
    "reliability.png",
    "outcomes.png",
)
_SCORES = ("brier", "log_score", "accuracy")
_SCORES_OF_PEAKS = ("crps", "ks_distance", "ks_p_value")
# Times on two processors of 2024 [s]: of a block between two samples of a motion, and of a fit
# with what each block in each test adds. They include rounds with more blocks.
_SIMULATION_TIME = 5e-9
_FIT_TIME = 0.6
_FIT_TIME_OF_OUTCOME = 2e-6


def validate(  # noqa: PLR0913
    file: Path,
    *,
    splits: Count = 40,
    seed: Count = 0,
    samples: Count | None = None,
    prior: tuple[str, ...] = (),
    one_sided: bool = False,
    floor_period: float | None = None,
    floor_damping: float | None = None,
    model: ModelName = "nonlinear",
    size_options: SizeOptions = SizeOptions(),
    out: Folder = Path("validation"),
    output: FileOutput = FileOutput(),
) -> Answer:
    """Fit blocks to tests with known outcomes, and score their predictions for other tests.

    The file has a line with the names of its columns, and below it a line for each test.
    Columns are file (the motion), overturned (yes or no), and optionally unit, time step [s],
    column, scale, group, peak rotation [rad] and name. A group, such as an earthquake, is
    fitted as a whole or not at all. In each split, blocks are fitted to half of the groups
    and predict the other half; for comparison the same is done with a rule in PGV, a rule in
    PGA, and the base rate, which is the frequency of overturning.
    The block need not be known. Give its size or a prior if you know them.

    Writes validation.nc, tests.csv, scores.csv, population.csv, reliability.png and
    outcomes.png.

    Example: jaxrock validate tests.csv

    Example: jaxrock validate tests.csv --prior critical_angle=0.2:0.1

    Parameters
    ----------
    file
        The file with the tests.
    splits
        Number of random splits of the groups into a fitted and a predicted half.
    seed
        Seed of the splits and of the blocks.
    samples
        Number of blocks that are simulated under each motion, a power of 2. If not given,
        8192 for up to 128 tests, 4096 for up to 256, 2048 for more.
    prior
        Prior medians and their coefficients of variation: critical_angle=0.08:0.1 is 0.08 rad
        with a coefficient of 0.1.
    one_sided
        The block stands against a wall, and rocks away from it only.
    floor_period
        Period of the floor on which the block stands [s]. Without it, the block stands on the
        ground.
    floor_damping
        Damping ratio of that floor [-]. 0.05 if not given.
    model
        Equation of motion.
    out
        Folder to write to; made if it is missing.
    """
    about = describe_options("validate", locals())
    known = _read_known(prior, size_options)
    if splits < 1:
        raise ValueError(f"--splits must be at least 1, got {splits}")
    tests = read_tests(file)
    gravity = size_options.gravity
    inertia_ratio = size_options.inertia_ratio
    campaign = check_campaign(
        suite=put_on_floor(tests.suite, floor_period, floor_damping),
        overturned=tests.overturned,
        groups=tests.groups,
        peak_rotations=tests.peak_rotations,
        prior=known,
        samples=samples,
        seed=seed,
        model=model,
        gravity=9.81 if gravity is None else gravity,
        inertia_ratio=RECTANGLE_INERTIA_RATIO if inertia_ratio is None else inertia_ratio,
        one_sided=one_sided,
    )
    with write_whole("out", out, _FILES, output.force) as folder:
        from ..plot import plot_outcomes, plot_reliability

        _announce_work(tests, campaign.samples, splits)
        fitted, scores = fit_and_score(campaign, splits)
        scores = scores.assign_attrs(about)
        scores.to_netcdf(folder / "validation.nc")
        write_csv(folder / "tests.csv", *_collect_tests(scores), about)
        summary = _summarize_scores(scores)
        write_csv(folder / "scores.csv", summary, dict.fromkeys([*summary][1:], "-"), about)
        population = _collect_population(fitted)
        write_csv(folder / "population.csv", population, {}, about)
        save_picture(plot_reliability(scores), folder / "reliability.png")
        save_picture(plot_outcomes(scores), folder / "outcomes.png")
    lines = [str(tests.suite), _write_scores(summary, splits)]
    of_peaks = {
        name: float(scores[name].mean("split")) for name in _SCORES_OF_PEAKS if name in scores
    }
    if of_peaks:
        lines.append(
            f"peak rotations, mean: CRPS {of_peaks['crps']:.4g} rad, Kolmogorov-Smirnov"
            f" distance {of_peaks['ks_distance']:.3f}, its p-value"
            f" {of_peaks['ks_p_value']:.3g}"
        )
    text = "\n".join([*lines, str(fitted)])
    data = {
        "tests": fitted.tests,
        "overturned": int(np.asarray(tests.overturned).sum()),
        "groups": fitted.groups,
        "blocks": scores.attrs["blocks"],
        "scores": list_rows(summary),
        **of_peaks,
        "population": list_rows(population),
        "remarks": fitted.remarks,
    }
    return Answer(text, data, output, [out / name for name in _FILES])


def _read_known(
    prior: tuple[str, ...], size: SizeOptions
) -> Block | dict[str, tuple[float, float]] | None:
    """Read what is known of the block: its size, or medians with coefficients of variation."""
    if size.width is None:
        refuse("--width", height=size.height, slenderness=size.slenderness)
        return _parse_prior(prior) if prior else None
    if prior:
        raise ValueError(
            f"--prior and --width exclude each other, got {prior[0]}: leave out one of them"
        )
    return size.make_block(size.width)


def _parse_prior(prior: tuple[str, ...]) -> dict[str, tuple[float, float]]:
    """Parse NAME=MEDIAN:COEFFICIENT; the library checks names and numbers."""
    known: dict[str, tuple[float, float]] = {}
    for word in prior:
        name, _, numbers = word.partition("=")
        try:
            median, coefficient = map(float, numbers.split(":"))
        except ValueError:
            raise ValueError(
                "prior must be NAME=MEDIAN:COEFFICIENT, such as critical_angle=0.08:0.1, got"
                f" {word!r:.60}"
            ) from None
        if name in known:
            raise ValueError(f"prior must have a name once, got {name} twice")
        known[name] = (median, coefficient)
    return known


def _announce_work(tests: Outcomes, samples: int, splits: int) -> None:
    """Say how much will be simulated and fitted, and about how long that takes."""
    # A quarter more of the blocks is drawn from the prior.
    blocks = samples + samples // 4
    points = sum(record.samples for record in tests.suite)
    # All tests are fitted as well.
    fits = splits + 1
    seconds = points * blocks * _SIMULATION_TIME
    seconds += fits * (_FIT_TIME + _FIT_TIME_OF_OUTCOME * blocks * len(tests.suite))
    announce(
        f"simulating {blocks:,} blocks or more under {len(tests.suite)} motions, and {fits}"
        f" fits, takes some {max(seconds, 1):.0f} s"
    )


def _collect_tests(
    scores: "xarray.Dataset",
) -> tuple[dict[str, list[object]], dict[str, str]]:
    """Collect the columns of the table of tests, and their units."""
    columns: dict[str, list[object]] = {"name": scores.test.values.tolist()}
    units: dict[str, str] = {}
    for name in ("group", "pgv", "pga", "overturned", "peak_rotation"):
        if name in scores:
            columns[name] = scores[name].values.tolist()
            units[name] = scores[name].attrs.get("units", "")
    for predictor in scores.predictor.values.tolist():
        head = f"probability by {predictor}"
        columns[head] = scores.probability.sel(predictor=predictor).values.tolist()
        units[head] = "-"
    return columns, units


def _summarize_scores(scores: "xarray.Dataset") -> dict[str, list[object]]:
    """Compute mean and standard deviation over the splits, a row for each predictor."""
    columns: dict[str, list[object]] = {"predictor": scores.predictor.values.tolist()}
    for name in _SCORES:
        mean = scores[name].mean("split")
        # One split says nothing of others.
        deviation = (
            scores[name].std("split", ddof=1) if scores.sizes["split"] > 1 else mean * np.nan
        )
        columns[name] = mean.values.tolist()
        columns[f"{name}_deviation"] = deviation.values.tolist()
    return columns


def _collect_population(fitted: OutcomeFit) -> dict[str, list[object]]:
    """List the parameters of the population, a row each, with their intervals."""
    intervals = fitted.compute_intervals()
    # Its fields are in the order of the intervals.
    fields = jax.tree.leaves(fitted.population)
    values = np.concatenate([np.ravel(field) for field in fields]).tolist()
    # The interval of the last correlation is that of a partial one.
    intervals["correlation_frequency_parameter_restitution"] = (math.nan, math.nan)
    # The tests say nothing of what they have not.
    missing = {"group_deviation"} if not fitted.grouped else set()
    missing |= {"peak_deviation"} if fitted.data.log_peak is None else set()
    rows = [
        (name, value, *ends)
        for (name, ends), value in zip(intervals.items(), values, strict=True)
        if name not in missing
    ]
    names = ("parameter", "value", "low", "high")
    return {
        name: list(column) for name, column in zip(names, zip(*rows, strict=True), strict=True)
    }


def _write_scores(summary: dict[str, list[object]], splits: int) -> str:
    """Write the table of the scores."""
    columns = {
        name: [
            f"{mean:.3f} ± {deviation:.3f}" if splits > 1 else f"{mean:.3f}"
            for mean, deviation in zip(
                summary[name], summary[f"{name}_deviation"], strict=True
            )
        ]
        for name in _SCORES
    }
    title = (
        "scores for tests that were not fitted"
        f"{f', mean and standard deviation of {splits} splits' if splits > 1 else ''}"
    )
    return format_table(title, [str(name) for name in summary["predictor"]], **columns)
