"""The commands about measured blocks: impact times, and tests that overturned or stood."""

from pathlib import Path

from .. import calibration
from .answers import Answer, list_rows
from .options import BlockOptions, Count, FileOutput, ModelName, refuse


def fit(
    file: Path,
    *,
    model: ModelName | None = None,
    block_options: BlockOptions = BlockOptions(),
    output: FileOutput = FileOutput(),
) -> Answer:
    """Fit restitution, and if need be frequency parameter p, to impact times of a block.

    In a test the block is tilted and let go; a microphone or an accelerometer beside it hears
    the impacts. The file has a line for each impact below the names of its columns: time [s],
    or [ms], and optionally peak rotation [rad], or [deg], the largest one before the next
    impact. Without a width the block is unknown, and p is fitted too. Writes fit.csv, with a
    line for each time, and fit.png.

    Example: jaxrock fit times.csv

    Example: jaxrock fit times.csv --width 0.2 --height 1

    Parameters
    ----------
    file
        The file with the times of the impacts.
    model
        Equation of motion. By default nonlinear with a block; always linearized without one.
    """
    block = block_options.block_if_given
    refuse("where it is fitted", restitution=block_options.restitution)
    times, peaks = calibration.read_impact_times(file)
    with output.write("fit", "fit.csv", "fit.png", dataset=False) as files:
        fitted = calibration.fit_free_rocking(times, block, peak_rotations=peaks, model=model)
        columns = fitted.table()
        files.write_csv("fit.csv", columns)
        files.save_picture("fit.png", fitted.plot())
    data = {**fitted.summarize(), "rows": list_rows(columns)}
    return Answer(fitted, data, output, files.paths)


def validate(
    file: Path,
    *,
    splits: Count = 40,
    seed: Count = 0,
    samples: Count | None = None,
    model: ModelName = "nonlinear",
    block_options: BlockOptions = BlockOptions(),
    output: FileOutput = FileOutput(),
) -> Answer:
    """Fit blocks to tests with known outcomes, and score their predictions for other tests.

    The file has a line with the names of its columns, and below it a line for each test.
    Columns are file (the motion), overturned (yes or no), and optionally unit, time step [s],
    column, scale, group and name. A group, such as an earthquake, is
    fitted as a whole or not at all. In each split, blocks are fitted to half of the groups
    and predict the other half; for comparison the same is done with a rule in PGV, a rule in
    PGA, and the base rate, which is the frequency of overturning.
    The block need not be known. Give its size if you know it.

    Writes validation.nc, tests.csv, scores.csv, population.csv, reliability.png and
    outcomes.png.

    Example: jaxrock validate tests.csv

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
    model
        Equation of motion.
    """
    refuse("where it is fitted", restitution=block_options.restitution)
    tests = calibration.read_tests(file)
    campaign = calibration.check_campaign(
        tests.suite,
        tests.overturned,
        tests.groups,
        prior=block_options.block_if_given,
        samples=samples,
        seed=seed,
        model=model,
        gravity=block_options.gravity,
        inertia_ratio=block_options.inertia_ratio,
        one_sided=block_options.one_sided,
    )
    names = ("validation.nc", "tests.csv", "scores.csv", "population.csv")
    pictures = ("reliability.png", "outcomes.png")
    with output.write("validation", *names, *pictures, dataset=False) as files:
        from ..plot import plot_outcomes, plot_reliability

        fitted, scores = calibration.fit_and_score(campaign, splits)
        summary = calibration.tabulate_scores(scores)
        scores.assign_attrs(files.about).to_netcdf(files.folder / "validation.nc")
        files.write_csv("tests.csv", calibration.tabulate_tests(scores))
        files.write_csv("scores.csv", summary)
        files.write_csv("population.csv", fitted.table())
        files.save_picture("reliability.png", plot_reliability(scores))
        files.save_picture("outcomes.png", plot_outcomes(scores))
    numbers = {name: getattr(fitted, name) for name in ("tests", "overturned", "groups")}
    rows = {"scores": list_rows(summary), "population": list_rows(fitted.table())}
    data = {**numbers, "blocks": scores.attrs["blocks"], **rows, "remarks": fitted.remarks}
    text = f"{tests.suite}\n{calibration.describe_scores(scores)}\n{fitted}"
    return Answer(text, data, output, files.paths)
