"""``jaxrock run study.toml``: several commands from one file."""

import functools
import tomllib
import types
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

import tyro

from ..host import read_regular, with_progress
from .commands import COMMANDS
from .options import COMMON, Answer, Command, GridValue, Writing

_TABLES = ("common", "job")
_ALLOWED = {
    float: "a number",
    int: "a whole number",
    bool: "true or false",
    str: "text",
    Path: "text",
    GridValue: 'numbers or "START:STOP:COUNT"',
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
        _ = self.jobs

    def run(self) -> Answer:
        """Run the jobs in their order."""
        texts, answers, errors = [], [], []
        for name, command in with_progress(self.jobs, "jobs"):
            try:
                answer = command.run()
            except (ValueError, OSError, MemoryError) as error:
                answer = Answer(f"error: {error}", {"error": str(error)}, 2)
                errors.append(f"{self.study}: {name}: {error}")
            texts.append(f"{name}\n{answer.text}")
            answers.append({"job": name, "code": answer.code, **answer.data})
        code = max(answer["code"] for answer in answers)
        return Answer("\n\n".join(texts), {"jobs": answers}, code, errors)

    @functools.cached_property
    def jobs(self) -> list[Job]:
        """The jobs, checked; a `ValueError` names all faults of the study."""
        faults: list[str] = []
        try:
            jobs = _jobs(_read(self.study), self.study.parent, faults)
        except RecursionError:
            raise ValueError(f"study: {str(self.study)!r} is nested too deeply") from None
        for name, command in with_progress(jobs, "checking jobs"):
            try:
                command.check()
            except ValueError as error:
                faults.append(f"{name}: {error}")
        faults += _collisions(jobs)
        if faults:
            raise ValueError("\n  ".join([f"{self.study} cannot be run:", *dict.fromkeys(faults)]))
        return jobs


def _read(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(read_regular(path).decode("utf-8-sig"))
    except OSError as error:
        raise ValueError(f"study: {str(path)!r} cannot be read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"study: {str(path)!r} is not TOML: {error}") from error


def _jobs(study: dict[str, Any], folder: Path, faults: list[str]) -> list[Job]:
    """The jobs that can be made; `faults` gets what is wrong with the others."""
    faults += [
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
    unused, jobs = dict(common), []
    for number, table in enumerate(tables, 1):
        kind = table.get("command")
        if not isinstance(kind, str) or kind not in COMMANDS:
            got = repr(kind)[:60] if "command" in table else f"only {', '.join(table) or 'nothing'}"
            allowed = ", ".join(COMMANDS)
            faults.append(f"job {number}: command must be one of {allowed}, got {got}")
            continue
        name, types_of = f"job {number} ({kind})", _types(COMMANDS[kind])
        shared = {key: value for key, value in common.items() if _option(key) in types_of}
        unused = {key: value for key, value in unused.items() if key not in shared}
        own = {key: value for key, value in table.items() if key != "command"}
        wrong: list[str] = []
        options = _converted(shared, types_of, f"{name}: common: ", wrong)
        options |= _converted(own, types_of, f"{name}: ", wrong)
        faults += wrong
        if not wrong:
            jobs.append(Job(name, COMMANDS[kind](**_placed(options, COMMANDS[kind], folder))))
    faults += [f"common: {key} is an option of no job" for key in unused]
    return jobs


@functools.cache
def _types(command: type[Command]) -> dict[str, Any]:
    """The types of the options that a job may have, by name."""
    hints = get_type_hints(command)
    return {field.name: hints[field.name] for field in fields(command) if field.name not in COMMON}


def _option(key: str) -> str:
    return key.replace("-", "_")


def _converted(
    table: dict[str, Any], types_of: dict[str, Any], where: str, faults: list[str]
) -> dict[str, Any]:
    """The options of a table in their types; `faults` gets what is wrong with the others."""
    options: dict[str, Any] = {}
    written: dict[str, str] = {}
    for key, value in table.items():
        option = _option(key)
        if option not in types_of:
            faults.append(f"{where}{key} is unknown; allowed are {', '.join(types_of)}")
            continue
        if option in written:
            faults.append(f"{where}{key} and {written[option]} are the same")
        written[option] = key
        try:
            options[option] = _as(types_of[option], value)
        except ValueError as error:
            faults.append(f"{where}{key} must be {error}, got {value!r:.60}")
    return options


def _as(kind: Any, value: Any) -> Any:
    """A value of a study as the type of an option; a `ValueError` says what is allowed."""
    origin, parts = get_origin(kind), get_args(kind)
    # An option that may be left out: TOML has no None. Of a `Literal`, Python makes a `Union`.
    if origin in (Union, types.UnionType) and type(None) in parts:
        return _as(parts[0], value)
    if origin is tuple:
        values = value if isinstance(value, list) else [value]
        return tuple(_as(parts[0], each) for each in values)
    if origin is Literal and value not in parts:
        raise ValueError(f"one of {', '.join(parts)}")
    if type(value) in (int, float) and kind in (float, GridValue):
        try:
            return float(value)
        except OverflowError:
            raise ValueError("a number that is not too large") from None
    if isinstance(value, str) and kind is Path:
        return Path(value)
    if origin is Literal or type(value) is kind or (isinstance(value, str) and kind == GridValue):
        return value
    raise ValueError(_ALLOWED[kind])


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


def _collisions(jobs: list[Job]) -> Iterator[str]:
    """Faults of jobs whose files are also files of other jobs, or their folders.

    By dictionaries, so that the time is in proportion to the number of jobs.
    """
    files: dict[Path, str] = {}
    folders: dict[Path, str] = {}
    for name, command in jobs:
        if not isinstance(command, Writing) or command.out is None:
            continue
        folder = command.out.resolve()
        above = (folder, *folder.parents)
        paths = [folder / file for file in command.names]
        blocked = [files[path] for path in above if path in files]
        for path in paths:
            others = [claimed[path] for claimed in (files, folders) if path in claimed]
            for other in dict.fromkeys(others + blocked):
                yield f"{name}: out: {str(path)!r} is in the way of {other}"
        files.update(dict.fromkeys(paths, name))
        folders.update(dict.fromkeys(above, name))
