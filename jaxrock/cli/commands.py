"""The commands by name."""

from .assess import Assess
from .conformance import Conformance
from .critical import Critical
from .options import Command
from .paper import Paper
from .respond import Respond
from .rocking_spectrum import RockingSpectrum
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
