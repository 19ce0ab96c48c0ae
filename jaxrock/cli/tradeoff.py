"""``jaxrock tradeoff``."""

import functools
from dataclasses import dataclass
from pathlib import Path

from ..accuracy import default_scene, measure_tradeoff
from ..dynamics import DrivenScene
from ..resonance import Scene
from .options import Answer, BlockOptions, MotionOptions, Writing
from .output import picture


@dataclass(frozen=True, kw_only=True)
class Tradeoff(MotionOptions, BlockOptions, Writing):
    """Speed against accuracy on this machine: every dial turned, errors and times measured.

    Of a block under a pulse or a record, with --intensity under the pulses of resonance, by
    default under a short half-sine pulse. Writes tradeoff.nc, tradeoff.csv and tradeoff.png.

    Example: jaxrock tradeoff --record example
    """

    restitution: float | None = 0.7
    """Velocity after an impact over velocity before it [-], 0 to 1."""
    intensity: float | None = None
    """Change of ground velocity in each instantaneous pulse [m/s]."""
    repeats: int = 15
    """How many times each setting is timed."""
    out: Path = Path("tradeoff")

    @property
    def names(self) -> list[str]:
        """A dataset, a table and a picture."""
        return [f"tradeoff.{kind}" for kind in ("nc", "csv", "png")]

    @property
    def scene(self) -> Scene | DrivenScene:
        """What is measured."""
        if self.intensity is not None:
            if self.shaken:
                raise ValueError("intensity excludes a pulse or a record")
            self.refuse_motion()
            return Scene(self.block, self.coefficient, self.intensity)
        if not self.shaken:
            self.refuse_motion()
        motion = self.motion if self.shaken else default_scene().motion
        return DrivenScene(self.block, self.coefficient, motion)

    def check(self) -> None:
        """The scene, the repeats and the files."""
        _ = self.scene
        if self.repeats < 1:
            raise ValueError(f"repeats must be at least 1, got {self.repeats}")
        super().check()

    def run(self) -> Answer:
        """Measure it."""
        from ..plot import plot_tradeoff

        tradeoff = measure_tradeoff(self.scene, repeats=self.repeats)
        table = tradeoff.dataset.to_dataframe()
        with self.written() as scratch:
            tradeoff.dataset.to_netcdf(scratch / self.names[0])
            table.to_csv(scratch / self.names[1], index=False)
            draw = functools.partial(plot_tradeoff, tradeoff.dataset)
            picture(draw, scratch / self.names[2], figsize=(8, 5))
        rows = table.to_dict("records")
        data = {"rows": rows, "sentence": tradeoff.sentence(), "notes": tradeoff.notes()}
        return self.finished(str(tradeoff), data)
