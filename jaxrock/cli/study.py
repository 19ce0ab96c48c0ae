"""``jaxrock run study.toml``: what one would otherwise script."""

import functools
import tomllib
import types
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

import tyro

from ..host import read_regular, with_progress
from .commands import COMMANDS
from .options import COMMON, Answer, Command, Writing

_TABLES = ("common", "job")
_WORDS = {
    float: "a number",
    int: "a whole number",
    bool: "true or false",
    str: "text",
    Path: "text",
}


class Job(NamedTuple):
    """One command of a study, with the name that errors and answers give it."""

    name: str
    command: Command


@dataclass(frozen=True, kw_only=True)
class Run(Command):
    """Run the jobs of a study file, all of them checked before the first one starts.

    A study is a TOML file with a table [[job]] for each: its command and that command's
    options, written with dashes or underscores; grids are numbers, lists or "START:STOP:COUNT".
    Options in a table [common] hold for every job that has them. Paths start at the folder of
    the study. A job that fails does not keep the others from running.

    Example: jaxrock run study.toml
    """

    study: Annotated[Path, tyro.conf.Positional]
    """The study file."""

    def check(self) -> None:
        """Every job: its keys, their values, its files."""
        self.jobs()

    def run(self) -> Answer:
        """Run the jobs in their order."""
        texts, answers, errors, code = [], [], [], 0
        for job in with_progress(self.jobs(), "jobs"):
            try:
                answer = job.command.run()
            except (ValueError, OSError, MemoryError) as error:
                answer = Answer(f"error: {error}", {"error": str(error)}, 2)
                errors.append(f"{self.study}: {job.name}: {error}")
            texts.append(f"{job.name}\n{answer.text}")
            answers.append({"job": job.name, "code": answer.code, **answer.data})
            code = max(code, answer.code)
        return Answer("\n\n".join(texts), {"jobs": answers}, code, errors)

    def jobs(self) -> list[Job]:
        """The jobs, checked once."""
        return self._jobs

    @functools.cached_property
    def _jobs(self) -> list[Job]:
        """The jobs, checked; a `ValueError` says all that is wrong."""
        try:
            jobs, faults = _parsed(_read(self.study), self.study.parent)
        except RecursionError:
            raise ValueError(f"study: {str(self.study)!r} is nested too deeply") from None
        claimed = _Claimed()
        for job in with_progress(jobs, "checking jobs"):
            try:
                job.command.check()
            except ValueError as error:
                faults.append(f"{job.name}: {error}")
            if isinstance(job.command, Writing) and job.command.out is not None:
                faults += claimed.in_the_way(job.name, job.command.out, job.command.names)
        if faults:
            raise ValueError("\n  ".join([f"{self.study} cannot be run:", *dict.fromkeys(faults)]))
        return jobs


class _Claimed:
    """The files that jobs are going to write, found by their paths and by their folders."""

    def __init__(self) -> None:
        self.files: dict[Path, str] = {}
        self.folders: dict[Path, str] = {}

    def in_the_way(self, job: str, folder: Path, names: Sequence[str]) -> list[str]:
        """Claim the files `names` of a job; what is said of each that is in another's way."""
        folder = folder.resolve()
        above = (folder, *folder.parents)
        faults = []
        # A file is in the way of itself and of a folder of its name, either way round.
        blocked = [self.files[path] for path in above if path in self.files]
        for file in (folder / name for name in names):
            others = [known[file] for known in (self.files, self.folders) if file in known]
            faults += [
                f"{job}: out: {str(file)!r} is in the way of {other}"
                for other in dict.fromkeys(others + blocked)
            ]
        self.files.update((folder / name, job) for name in names)
        self.folders.update((path, job) for path in above)
        return faults


def _read(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(read_regular(path).decode("utf-8-sig"))
    except OSError as error:
        raise ValueError(f"study: {str(path)!r} cannot be read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"study: {str(path)!r} is not TOML: {error}") from error


def _parsed(study: dict[str, Any], folder: Path) -> tuple[list[Job], list[str]]:
    """The jobs that can be made, and what is wrong with the others."""
    faults = [
        f"{key} is unknown; allowed are {', '.join(_TABLES)}" for key in study if key not in _TABLES
    ]
    common, tables = study.get("common", {}), study.get("job", [])
    if not isinstance(common, dict):
        faults.append("common must be a table [common]")
        common = {}
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        faults.append("job must be tables [[job]]")
        tables = []
    elif not tables:
        faults.append("job is missing: there must be at least one table [[job]]")
    used: set[str] = set()
    jobs = []
    for number, table in enumerate(tables, 1):
        job, wrong = _job(f"job {number}", table, common, used, folder)
        faults += wrong
        if job is not None:
            jobs.append(job)
    faults += [f"common: {key} is an option of no job" for key in common if key not in used]
    return jobs, faults


def _job(
    name: str, table: dict[str, Any], common: dict[str, Any], used: set[str], folder: Path
) -> tuple[Job | None, list[str]]:
    kind = table.get("command")
    if not isinstance(kind, str) or kind not in COMMANDS:
        given = (
            f"got {kind!r:.60}"
            if "command" in table
            else f"got only {', '.join(table) or 'nothing'}"
        )
        return None, [f"{name}: command must be one of {', '.join(COMMANDS)}, {given}"]
    name = f"{name} ({kind})"
    command = COMMANDS[kind]
    types_of = _type_hints(command)
    allowed = [field.name for field in fields(command) if field.name not in COMMON]
    own = {key: value for key, value in table.items() if key != "command"}
    options: dict[str, Any] = {}
    faults = []
    for where, part in (("common: ", common), ("", own)):
        written: dict[str, str] = {}
        for key, value in part.items():
            option = key.replace("-", "_")
            if option not in allowed:
                if not where:
                    faults.append(f"{name}: {key} is unknown; allowed are {', '.join(allowed)}")
                continue
            if option in written:
                faults.append(f"{name}: {where}{key} and {written[option]} are the same")
            written[option] = key
            used.update({key} if where else ())
            try:
                options[option] = _converted(value, types_of[option])
            except ValueError as error:
                faults.append(f"{name}: {where}{key} must be {error}, got {value!r:.60}")
    return (
        (None, faults) if faults else (Job(name, command(**_placed(options, command, folder))), [])
    )


_type_hints = functools.cache(get_type_hints)


def _placed(options: dict[str, Any], command: type[Command], folder: Path) -> dict[str, Any]:
    """The options with the paths that start at the folder of the study."""
    placed = dict(options)
    out = options.get("out", getattr(command, "out", None))
    if out is not None:
        placed["out"] = folder / out
    if options.get("record") not in (None, "example"):
        placed["record"] = str(folder / options["record"])
    if str(options.get("vertical")).lower().endswith(".at2"):  # a file, no column
        placed["vertical"] = str(folder / options["vertical"])
    return placed


def _converted(value: Any, kind: Any) -> Any:
    """A value of a study as the type of an option; a `ValueError` says what is allowed."""
    if get_origin(kind) in (Union, types.UnionType):
        (kind,) = (part for part in get_args(kind) if part is not type(None))
    if get_origin(kind) is Literal:
        if value not in get_args(kind):
            raise ValueError(f"one of {', '.join(get_args(kind))}")
        return value
    if get_origin(kind) is tuple:
        parts = value if isinstance(value, list) else [value]
        inner = get_args(kind)[0]
        if inner is float:
            return tuple(_converted(part, float) for part in parts)
        if not all(isinstance(part, str) or _is_number(part) for part in parts):
            raise ValueError('numbers or "START:STOP:COUNT"')
        return tuple(part if isinstance(part, str) else repr(part) for part in parts)
    if kind is float and _is_number(value):
        try:
            return float(value)
        except OverflowError:
            raise ValueError("a number that is not too large") from None
    if kind is Path and isinstance(value, str):
        return Path(value)
    if kind in (int, bool, str) and type(value) is kind:
        return value
    raise ValueError(_WORDS[kind])


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
