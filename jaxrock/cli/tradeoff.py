"""The command that measures speed against accuracy."""

from pathlib import Path

from ..accuracy import make_default_scene, measure_tradeoff
from ..driven import DrivenScene
from ..grids import write_table
from ..host import write_whole
from ..resonance import Scene
from .answers import Answer, describe_options, save_picture
from .motion_options import MotionOptions
from .options import BlockOptions, FileOutput, Folder, refuse_beside, warn_of_intensity

_FILES = ("tradeoff.nc", "tradeoff.csv", "tradeoff.png")


def tradeoff(
    *,
    intensity: float | None = None,
    block_options: BlockOptions = BlockOptions(),
    motion_options: MotionOptions = MotionOptions(),
    out: Folder = Path("tradeoff"),
    output: FileOutput = FileOutput(),
) -> Answer:
    """Measure error and time of each equation, solver and precision on this machine.

    The block is under a pulse or a record, or with --intensity under pulses right after each
    impact. By default it is under a short half-sine pulse. Writes tradeoff.nc, tradeoff.csv
    and tradeoff.png.

    Example: jaxrock tradeoff --record example

    Parameters
    ----------
    intensity
        Change of ground velocity in each instantaneous pulse [m/s].
    out
        Folder to write to; made if it is missing.
    """
    about = describe_options("tradeoff", locals())
    block = block_options.block
    c = block_options.coefficient
    motion = make_default_scene().motion
    if motion_options.given:
        motion = motion_options.read()
        refuse_beside("--pulse or --record", intensity=intensity)
    else:
        motion_options.refuse_all("--pulse or --record")
    if intensity is not None:
        warn_of_intensity(intensity)
    scene = Scene(block, c, intensity) if intensity is not None else None
    with write_whole("out", out, _FILES, output.force) as folder:
        from ..plot import plot_tradeoff

        measured = measure_tradeoff(scene or DrivenScene(block, c, motion))
        dataset = measured.dataset.assign_attrs(about)
        dataset.to_netcdf(folder / "tradeoff.nc")
        write_table(dataset, folder / "tradeoff.csv")
        save_picture(plot_tradeoff(measured.dataset), folder / "tradeoff.png")
    data = {
        "rows": dataset.to_dataframe().to_dict("records"),
        "sentence": measured.sentence(),
        "notes": measured.notes(),
    }
    return Answer(str(measured), data, output, [out / name for name in _FILES])
