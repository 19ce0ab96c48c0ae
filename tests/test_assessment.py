import jax
import numpy as np
import pytest

import jaxrock as jr

BLOCK = jr.Block.from_size(width=0.8, height=4.0)


@pytest.mark.thorough
def test_every_answer_is_that_of_its_function():
    scene = jr.Scene(BLOCK, 0.7, 0.15)
    found = jr.reports.assess(BLOCK, 0.7, 0.15)
    assert found["scene"]["height"] == pytest.approx(4.0)
    for name, model in (("linearized", jr.Linearized()), ("nonlinear", jr.Nonlinear())):
        answers = found["models"][name]
        stabilized = answers["stabilized"]
        for key, function in (
            ("peak_rotation", jr.stabilized_rotation),
            ("rotation_ratio", jr.rotation_ratio),
            ("period", jr.stabilized_period),
            ("amplification", jr.amplification),
        ):
            np.testing.assert_allclose(stabilized[key], function(scene, model), rtol=1e-5)
        slopes = jax.grad(jr.rotation_ratio)(scene, model)
        np.testing.assert_allclose(
            answers["derivatives"]["half_width"], slopes.block.half_width, rtol=1e-5
        )
        assert answers["elasticities"]["intensity"] == pytest.approx(
            answers["derivatives"]["intensity"] * 0.15 / stabilized["rotation_ratio"], rel=1e-5
        )
        for label, count in (("1", 1), ("5", 5), ("unlimited", np.inf)):
            np.testing.assert_allclose(
                answers["critical_intensity"][label],
                jr.critical_intensity(BLOCK, 0.7, count, model),
                rtol=1e-5,
            )
    ratio = [found["models"][m]["stabilized"]["period"] for m in ("linearized", "nonlinear")]
    error = found["linearization_error"]["stabilized"]["period"]
    assert error == pytest.approx(ratio[0] / ratio[1] - 1, abs=1e-6)
    text = found.details()
    for number in (found["models"]["linearized"]["critical_intensity"]["2"], ratio[1]):
        assert f"{number:.6g}" in text
    assert "it stands, and settles at 12.4 % of the critical angle" in str(found)
    assert "nan" not in text


@pytest.mark.thorough
@pytest.mark.float64
def test_sensitivities_to_the_sides():
    """By differences of blocks made of sides."""
    found = jr.reports.assess(BLOCK, 0.7, 0.15)

    def ratio(width, height, model):
        block = jr.Block.from_size(width=width, height=height)
        return float(jr.rotation_ratio(jr.Scene(block, 0.7, 0.15), model))

    for name, answers in found["models"].items():
        value = ratio(0.8, 4.0, name)
        for key, side, step in (
            ("width_at_this_height", 0.8, (1e-6, 0)),
            ("height_at_this_width", 4.0, (0, 1e-6)),
        ):
            change = ratio(0.8 + step[0], 4 + step[1], name) - ratio(
                0.8 - step[0], 4 - step[1], name
            )
            slope = change / 2e-6
            assert answers["derivatives"][key] == pytest.approx(slope, rel=1e-6)
            assert answers["elasticities"][key] == pytest.approx(
                slope * side / value, rel=1e-6
            )
