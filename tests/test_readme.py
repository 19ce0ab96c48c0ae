"""The README's quickstart runs and gives the numbers that stand beside it."""

import ast
import re
from pathlib import Path

import numpy as np
import pytest

README = Path(__file__).parent.parent / "README.md"


@pytest.mark.float64
def test_quickstart():
    code = re.search(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)[1]
    namespace, compared = {}, 0
    for statement in ast.parse(code).body:
        source = ast.get_source_segment(code, statement)
        if not isinstance(statement, ast.Expr):
            exec(source, namespace)
            continue
        value = eval(source, namespace)
        comment = code.splitlines()[statement.end_lineno - 1].partition("#")[2]
        for number, found in zip(
            re.findall(r"\b0?\d\.\d+", comment), np.ravel(value), strict=False
        ):
            assert f"{found:.{len(number.partition('.')[2])}f}" == number, source
            compared += 1
    assert compared == 7


BLOCKS = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
BEGIN = "\n".join(BLOCKS[0].splitlines()[:8]) + "\n"


def block_with(words):
    return next(block for block in BLOCKS if words in block)


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
    assert f"# {within.kept.mean():.2f}: the rest" in text
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
