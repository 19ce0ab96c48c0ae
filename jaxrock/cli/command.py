"""Base classes of commands: options, checks before they run, files, answers."""

import abc
import contextlib
import functools
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, dataclass_transform

import numpy as np
from cyclopts import Group, Parameter, Token

from ..ground_motion import list_suffixes
from ..host import check_free, read_version, write_whole

if TYPE_CHECKING:
    import matplotlib.axes
    import matplotlib.figure

# Panels of help, for options that several commands have.
OF_BLOCK = Parameter(group=Group("Block", sort_key=1))
OF_MOTION = Parameter(group=Group("Ground motion", sort_key=2))
OF_OUTPUT = Parameter(group=Group("Output", sort_key=3))
OF_STORE = Parameter(group=Group("Store", sort_key=4))

GridValue = float | str
Grid = tuple[GridValue, ...]  # numbers, and texts START:STOP:COUNT
Folder = Annotated[Path, OF_OUTPUT]


def as_count(_: type, tokens: Sequence[Token]) -> int:
    """Convert a word to a whole number; cyclopts itself would round 1.5."""
    try:
        return int(tokens[0].value)
    except ValueError:
        raise ValueError(f"{tokens[0].value!r} is not a whole number") from None


Count = Annotated[int, Parameter(converter=as_count)]
ModelName = Literal["linearized", "nonlinear"]


@dataclass(frozen=True)
class Answer:
    """Answer of a command: text, the same as data for JSON, exit code, errors."""

    text: str
    data: Mapping[str, object]
    code: int = 0
    errors: Sequence[str] = ()


# Yields once, the names of files; gets their folder, or None where no files are written.
Steps = Generator[Any, Any, Answer]


@dataclass_transform(frozen_default=True, kw_only_default=True)
@dataclass(frozen=True, kw_only=True)
class Command(abc.ABC):
    """Base class of a command: a dataclass with options as fields and their help beside them.

    The work of a command is a generator, `_carry_out`: above its `yield` it checks, below it
    computes. So everything that was read and checked is at hand when it computes, and a study
    can check all of its jobs before the first one starts.
    """

    # stage  | known by then                      | what may fail, and how it is said
    # -------+------------------------------------+-------------------------------------------
    # words  | values of the types of the fields  | `read_words`: `ValueError`, a sentence that
    #        |                                    | names the option
    # check  | `_carry_out` runs to its `yield`:  | `ValueError` for options that are wrong or
    #        | options and the files they name    | exclude each other, and for files that
    #        | are right; nothing is computed     | cannot be read; a study collects them
    # yield  | names of the files to be written   | `Writing.check`: `ValueError` for a file
    #        |                                    | that is there already, or in the way
    # run    | all is right. `Writing.run` sends  | `CannotWrite` for a folder that cannot be
    #        | a scratch folder; the generator    | written to, `ValueError` where there is no
    #        | goes on, computes, writes there    | answer; the scratch folder is removed
    # answer | the generator has returned; the    | exit code 1 where the answer itself is a
    #        | files are moved to their places    | failure; `errors`, of the jobs of a study
    #
    # `check` need not be called before `run`, and `run` may be called again: each time the
    # generator begins anew.

    command: ClassVar[str]  # as it is called
    as_json: Annotated[bool, OF_OUTPUT, Parameter(name="--json")] = False
    """Print JSON; null stands for what does not exist or never happens."""
    no_cache: Annotated[bool, OF_OUTPUT] = False
    """Compile everything afresh: neither use nor keep compiled programs."""

    def __init_subclass__(cls) -> None:
        """Make every subclass a dataclass, without a decorator that could be forgotten."""
        dataclass(frozen=True, kw_only=True)(cls)

    @abc.abstractmethod
    def _carry_out(self) -> Steps:
        """Yield the names of the files once all is checked; then get the folder for them."""

    @functools.cached_property
    def _checked_steps(self) -> tuple[Sequence[str], Steps]:
        """Names of the files, and the generator, which stands at its `yield`."""
        steps = self._carry_out()
        return next(steps), steps

    def _finish(self, folder: Path | None) -> Answer:
        """Let the generator compute and write into this folder; add a remark to its answer."""
        _, steps = self._checked_steps
        # A generator can be finished once: another `run` begins a new one. The class is
        # frozen, but a cached property stands in the dictionary of the instance.
        del vars(self)["_checked_steps"]
        try:
            # It ends, which Python tells by an exception: nothing is returned here.
            return steps.send(folder)
        except StopIteration as end:
            answer: Answer = end.value
        if not (remark := self._write_remark()):
            return answer
        text = f"{answer.text}\nremark: {remark}"
        data = {**answer.data, "remark": remark}
        return replace(answer, text=text, data=data)

    def _write_remark(self) -> str:
        """Write what a user should look at again; nothing by default."""
        return ""

    def check(self) -> None:
        """Raise `ValueError` for options that are wrong, before anything expensive is done."""
        _ = self._checked_steps

    def run(self) -> Answer:
        """Do what the command is for."""
        return self._finish(None)

    def refuse(self, *names: str, only_with: str) -> None:
        """Raise `ValueError` if one of these options is given, since it would be ignored."""
        for name in names:
            # The default of a field is an attribute of the class. One that is given as it is
            # by default cannot be told from it, and does no harm.
            if getattr(self, name) != getattr(type(self), name):
                raise ValueError(f"{name} goes with {only_with} only")

    def read_numbers(self, name: str) -> list[float]:
        """List the numbers of an option, given one by one or as START:STOP:COUNT."""
        values: Grid = getattr(self, name)
        if not values:
            raise ValueError(f"{name} must be at least one number, got none")
        return [number for value in values for number in _parse_numbers(name, value)]

    def _collect_options(self) -> dict[str, object]:
        """Collect the options. Subclasses put what follows from others where none is given."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def find_paths(self) -> dict[str, Path | str]:
        """Find the options that are paths: those of type Path, and files of records."""
        return {name: value for name, value in vars(self).items() if _is_path(name, value)}

    @classmethod
    def name_options(cls) -> list[str]:
        """Name the options that a job of a study may have."""
        return [field.name for field in fields(cls) if not hasattr(Command, field.name)]


def _is_path(name: str, value: object) -> bool:
    """Tell whether the value of an option is a path, and not a number or a word."""
    if not isinstance(value, str):
        return isinstance(value, Path)
    if name in ("record", "records"):
        return value != "example" and not value.startswith("fema-")
    # A component of the same file, or another file.
    return name == "vertical" and value.lower().endswith(list_suffixes())


def _parse_numbers(name: str, value: GridValue) -> list[float]:
    """Parse one number, or START:STOP:COUNT."""
    # All that `float`, `int` and unpacking refuse ends in the one sentence below.
    with contextlib.suppress(ValueError):
        if ":" not in str(value):
            return [float(value)]
        start, stop, count = str(value).split(":")
        ends = float(start), float(stop)
        if np.isfinite(ends).all() and int(count) > 0:
            return np.linspace(*ends, int(count)).tolist()
    raise ValueError(f"{name} must be numbers or START:STOP:COUNT, got {value!r}")


class Writing(Command):
    """A command that writes files, all or none."""

    out: Annotated[Path | None, OF_OUTPUT]
    """Folder to write to; made if it is missing."""
    force: Annotated[bool, OF_OUTPUT] = False
    """Overwrite existing files."""

    @property
    def about(self) -> dict[str, str | int | float]:
        """Version, command and options, from which its files were computed."""
        said = {
            name: _as_attribute(value)
            for name, value in self._collect_options().items()
            if value is not None and name not in _OF_WRITING
        }
        return {"source": f"jaxrock {read_version()}", "command": self.command, **said}

    @property
    def names(self) -> Sequence[str]:
        """The names of its files."""
        return self._checked_steps[0]

    @property
    def targets(self) -> list[Path]:
        """The paths that it writes."""
        return [] if self.out is None else [self.out / name for name in self.names]

    def check(self) -> None:
        """Raise `ValueError` also for files that exist and must not be overwritten."""
        super().check()
        if self.out is not None and self.names:
            # Before an hour of computing, and not only after it: `write_whole` checks again.
            check_free("out", self.out, self.names, self.force)

    def run(self) -> Answer:
        """Compute and write; the answer tells the paths of the files."""
        # An option such as `out` of `critical` may be left out: then there is only an answer.
        if self.out is None:
            files = []
            writing = contextlib.nullcontext()
        else:
            files = [str(self.out / name) for name in self.names]
            writing = write_whole("out", self.out, self.names, self.force)
        with writing as folder:
            answer = self._finish(folder)
        text = "\n".join([answer.text, *files])
        data = {**answer.data, "files": files}
        return replace(answer, text=text, data=data)


# Options that change no number, and so do not belong into the attributes of a file.
_OF_WRITING = ("as_json", "no_cache", "out", "force", "animate", "repeats")
_OF_WRITING += ("store", "chunks", "workers", "scheduler")


def _as_attribute(value: object) -> str | int | float:
    """Convert a value to an attribute of the CF conventions, which is a number or text."""
    # NetCDF has no type for a bool, which Python counts as an int.
    if isinstance(value, bool):
        return int(value)
    if isinstance(value, int | float):
        return value
    return " ".join(map(str, value)) if isinstance(value, tuple) else str(value)


def save_picture(drawn: "matplotlib.axes.Axes | matplotlib.figure.Figure", path: Path) -> None:
    """Write a figure, or the one that axes belong to, to a file."""
    import matplotlib.pyplot as plt

    figure: Any = drawn.figure
    figure.savefig(path, dpi=150)
    # pyplot keeps every figure until it is closed, also those of the jobs before in a study.
    plt.close(figure)
