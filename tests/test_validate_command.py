"""The command that calibrates blocks to tests and scores them: a small simulated campaign."""

import json
import re

import jax.numpy as jnp
import numpy as np
import pytest
import xarray
from tools.command import run

import jaxrock as jr
from jaxrock.calibration import cross_validate, read_tests

pytestmark = pytest.mark.float64

FILES = {
    *("validation.nc", "tests.csv", "scores.csv", "population.csv"),
    *("reliability.png", "outcomes.png"),
}
OPTIONS = ("--splits", 3, "--samples", 64, "--seed", 1)
FACTORS = (0.6, 0.9, 1.1, 1.4)


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """Write a table of three motions with four factors each, and blocks that differ."""
    folder = tmp_path_factory.mktemp("campaign")
    rows = ["file,unit,group,scale,overturned"]
    for k, period in enumerate((0.8, 1.0, 1.3)):
        times = np.arange(0, 1.5 * period, 0.02)
        pulse = jr.Sine(3.0, period)
        samples = np.asarray(pulse.horizontal(times))
        table = "".join(f"{t:.2f},{a:.5f}\n" for t, a in zip(times, samples, strict=True))
        (folder / f"{k}.csv").write_text(f"time [s],acc\n{table}")
        blocks = jr.Block(jnp.array([0.09, 0.1, 0.11, 0.1]), jnp.array([5.2, 5.0, 4.8, 5.3]))
        suite = jr.Suite([jr.Record(samples, 0.02)])
        for place, factor in enumerate(FACTORS):
            response = jr.respond_batch(blocks, 0.85, suite.scaled(factor))
            outcome = "yes" if response.overturned[0, place] else "no"
            rows.append(f"{k}.csv,m/s2,motion {k},{factor},{outcome}")
    path = folder / "tests.csv"
    path.write_text("\n".join([*rows, ""]))
    return path


def read_table(path):
    """Read the rows of a table below the options, by their names."""
    lines = path.read_text(encoding="utf-8").splitlines()
    names, *rows = [line.split(",") for line in lines if not line.startswith("#")]
    return {name: column for name, *column in zip(names, *rows, strict=True)}


@pytest.mark.thorough
def test_command(campaign, tmp_path, capsys):
    out = tmp_path / "out"
    code, text, err = run(capsys, "validate", campaign, *OPTIONS, "--out", out, "--json")
    assert code == 0
    announced = (
        "jaxrock: simulating 80 blocks or more under 12 motions, and 4 fits, takes some 2 s\n"
    )
    assert re.fullmatch(rf"{announced}(?:jaxrock: .*: (?:done in|\d+ % after) \d+ s\n)*", err)
    assert {path.name for path in out.iterdir()} == FILES
    tests = read_tests(campaign)
    options = {"samples": 64, "seed": 1}
    scores = cross_validate(tests.suite, tests.overturned, tests.groups, splits=3, **options)
    with xarray.open_dataset(out / "validation.nc") as dataset:
        for name, variable in scores.data_vars.items():
            np.testing.assert_array_equal(dataset[name], variable)
        assert dataset.attrs["samples"] == 64
    table = read_table(out / "tests.csv")
    assert table["name"] == list(tests.suite.names)
    assert table["group"] == list(tests.groups)
    blocks = [float(cell) for cell in table["probability by blocks [-]"]]
    np.testing.assert_array_equal(blocks, scores.probability.sel(predictor="blocks"))
    answer = json.loads(text)
    assert answer["tests"] == 12
    assert answer["overturned"] == int(np.sum(tests.overturned))
    assert [row["predictor"] for row in answer["scores"]] == scores.predictor.values.tolist()
    means = [row["brier"] for row in answer["scores"]]
    np.testing.assert_allclose(means, scores.brier.mean("split"), rtol=1e-12)
    deviations = np.std(scores.log_score.values, axis=1, ddof=1)
    printed = [
        float(cell) for cell in read_table(out / "scores.csv")["log_score_deviation [-]"]
    ]
    np.testing.assert_allclose(printed, deviations, rtol=1e-12)
    # Of groups without peaks; the interval of the last correlation is not known.
    population = read_table(out / "population.csv")
    assert len(population["parameter"]) == 11
    assert {"lapse", "group_deviation"} < set(population["parameter"])
    value, low, high = (
        np.array([float(cell) for cell in population[name]])
        for name in ("value", "low", "high")
    )
    assert np.isnan(low).sum() == 1
    assert ((low < value) & (value < high))[~np.isnan(low)].all()


@pytest.mark.thorough
def test_peaks_and_a_single_split(campaign, tmp_path, capsys):
    """Peaks are scored as well, and one split has no standard deviation."""
    lines = campaign.read_text().splitlines()
    rows = [
        f"{line},{'' if line.endswith('yes') else 5 + k}" for k, line in enumerate(lines[1:])
    ]
    path = campaign.with_name("peaks.csv")
    path.write_text("\n".join([f"{lines[0]},peak rotation [deg]", *rows, ""]))
    options = (
        "--splits",
        1,
        "--samples",
        64,
        "--floor-period",
        0.05,
        "--out",
        tmp_path / "out",
    )
    code, text, _ = run(capsys, "validate", path, *options)
    assert code == 0
    assert "scores for tests that were not fitted\n" in text
    assert re.search(r"rad, Kolmogorov-Smirnov distance \d\S+, its p-value \d\S+", text)
    population = read_table(tmp_path / "out" / "population.csv")
    assert population["parameter"][-1] == "peak_deviation"
    with xarray.open_dataset(tmp_path / "out" / "validation.nc") as dataset:
        assert dataset.attrs["floor_period"] == 0.05
        assert "crps" in dataset
