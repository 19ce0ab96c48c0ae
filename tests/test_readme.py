"""The README's quickstart runs and gives the numbers that stand beside it."""

import ast
import re
from pathlib import Path

import jax
import numpy as np
import pytest

import jaxrock as jr
from jaxrock.cli import Run

README = Path(__file__).parent.parent / "README.md"


BLOCKS = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
BEGIN = "\n".join(BLOCKS[0].splitlines()[:8]) + "\n"


def block_with(words):
    return next(block for block in BLOCKS if words in block)


def compared(code, namespace):
    """Run it; how many answers begin as the comment beside them says."""
    count = 0
    for statement in ast.parse(code).body:
        source = ast.get_source_segment(code, statement)
        if not isinstance(statement, ast.Expr):
            exec(source, namespace)
            continue
        value = np.ravel(eval(source, namespace))
        comment = code.splitlines()[statement.end_lineno - 1].partition("#")[2]
        for said in re.findall(r"\b(?:True|False|nan)|-?\b0?\d+\.\d+(?:e[-+]\d+)?", comment):
            found, value = value[0], value[1:]
            if said in ("True", "False"):
                assert bool(found) == (said == "True"), source
            else:
                assert float(found) == pytest.approx(float(said), rel=6e-3, nan_ok=True), source
                digits = len(said.partition("e")[0].partition(".")[2])
                kind = "e" if "e" in said else "f"
                assert f"{found:.{digits}{kind}}" == said, source
            count += 1
            if not value.size:
                break
    return count


@pytest.mark.float64
def test_quickstart():
    assert compared(BLOCKS[0], {}) == 9


@pytest.mark.float64
@pytest.mark.thorough
def test_sharp_edges():
    namespace = {}
    exec(BEGIN, namespace)
    with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
        assert compared(block_with("A textbook formula"), namespace) == 13


def test_the_study_passes_its_check(tmp_path):
    study = re.search(r"```toml\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)[1]
    path = tmp_path / "study.toml"
    path.write_text(study, encoding="utf-8")
    jobs = Run(study=path).jobs.values()
    assert [job.width for job in jobs] == [0.4, 0.4]
    assert [type(job.motion) for job in jobs] == [jr.Record, jr.HalfSine]


@pytest.mark.float64
def test_every_row_that_is_measured_is_in_the_readme():
    import measured

    text = README.read_text(encoding="utf-8")
    table = text.partition(measured.BEGIN)[2].partition(measured.END)[0]
    for row in measured.ROWS:
        assert f"| {row.what} | " in table
        assert (README.parent / row.where).exists()
    assert table.count("\n| ") == len(measured.ROWS) + 1


@pytest.mark.float64
@pytest.mark.thorough
def test_driven_motion():
    namespace = {}
    exec(BEGIN + block_with("jr.example_record()"), namespace)
    assert namespace["response"].impacts > 1000


@pytest.mark.float64
def test_values_and_slopes():
    namespace = {}
    exec(BEGIN + block_with("value_and_slopes").replace("1_000_000", "20_000"), namespace)
    assert namespace["slope"].intensity.shape == namespace["ratio"].shape == (20_000,)


GIVEN = """
restitution, strength = jnp.linspace(0.5, 0.9, 9), jnp.linspace(0.5, 3.0, 1000)
block, record = jr.Block(half_width=0.2, slenderness=5.0), jr.example_record()
"""


@pytest.mark.thorough
@pytest.mark.float64
def test_as_much_model_as_required(capsys):
    namespace = {}
    exec(BEGIN + GIVEN + block_with("model_error"), namespace)
    error, within = namespace["error"], namespace["within"]
    text = block_with("model_error")
    assert f"# {error.linearization.rotation_ratio:.4f}: what linearizing costs" in text
    estimate = f"{error.duration.period:.4f}, {error.duration_bound.period:.4f}"
    assert f"# {estimate}: what 10 ms" in text
    assert f"# {within.within_tolerance.mean():.2f}: the rest" in text
    printed = capsys.readouterr().out.splitlines()[0]
    assert f"# {printed}, and why" in text


@pytest.mark.float64
@pytest.mark.thorough
def test_inverse_design(capsys):
    design = block_with("overturning_boundaries")
    exec(BEGIN + GIVEN + design, {})
    printed = capsys.readouterr().out
    edges = re.findall(r"\w+ beyond [\d.]+\d", design)
    assert len(edges) == 3
    for edge in edges:
        assert edge in printed
