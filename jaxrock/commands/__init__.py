"""The commands, a file each: options as fields, `check` before anything runs, `run`."""

from .assess import Assess
from .conformance import Conformance
from .critical import Critical
from .options import Command, dumps
from .paper import Paper
from .respond import Respond
from .rocking_spectrum import RockingSpectrum
from .run import Run
from .sensitivity import Sensitivity
from .spectrum import Spectrum
from .tradeoff import Tradeoff

COMMANDS: dict[str, type[Command]] = {
    "assess": Assess,
    "spectrum": Spectrum,
    "respond": Respond,
    "rocking-spectrum": RockingSpectrum,
    "critical": Critical,
    "sensitivity": Sensitivity,
    "tradeoff": Tradeoff,
    "paper": Paper,
    "conformance": Conformance,
}

__all__ = ["COMMANDS", "Command", "Run", "dumps"]
