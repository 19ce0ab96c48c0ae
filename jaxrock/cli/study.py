"""``jaxrock run study.toml``: several commands from one file."""

import functools
import tomllib
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import tyro

from ..host import read_regular, with_progress
from .commands import COMMANDS
from .options import Answer, Command, GridValue, Writing

Jobs = dict[str, Command]  # by the names that errors and answers give them


class Run(Command):
    """Run the jobs of a study file, all of them checked before the first one starts.

    A study is a TOML file with a table [[job]] for each: its command and that command's
    options, written with dashes or underscores; grids are numbers, lists or "START:STOP:COUNT".
    Options in a table [common] hold for every job that has them. Paths start at the folder of
    the study. A job that fails does not keep the others from running.

    Example: jaxrock run study.toml
    """

    study: Annotated[Path, tyro.conf.Positional]  # The study file.

    def _inputs(self) -> Jobs:
        """The jobs, checked; a `ValueError` names all faults of the study."""
        faults: list[str] = []
        try:
            jobs = _jobs(_read(self.study), self.study.parent, faults)
        except RecursionError:
            raise ValueError(f"study: {str(self.study)!r} is nested too deeply") from None
        for name, command in with_progress(jobs.items(), "checking jobs"):
            try:
                command.check()
            except ValueError as error:
                faults.append(f"{name}: {error}")
        faults += _collisions(jobs)
        if faults:
            raise ValueError("\n  ".join([f"{self.study} cannot be run:", *dict.fromkeys(faults)]))
        return jobs

    def run(self) -> Answer:
        """Run the jobs in their order."""
        answers: dict[str, Answer] = {}
        for name, command in with_progress(self.inputs.items(), "jobs"):
            try:
                answers[name] = command.run()
            except (ValueError, OSError, MemoryError) as error:
                said = [f"{self.study}: {name}: {error}"]
                answers[name] = Answer(f"error: {error}", {"error": str(error)}, 2, said)
        return Answer(
            "\n\n".join(f"{name}\n{answer.text}" for name, answer in answers.items()),
            {"jobs": [{"job": n, "code": a.code, **a.data} for n, a in answers.items()]},
            max(answer.code for answer in answers.values()),
            [error for answer in answers.values() for error in answer.errors],
        )


def _read(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(read_regular(path).decode("utf-8-sig"))
    except OSError as error:
        raise ValueError(f"study: {str(path)!r} cannot be read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"study: {str(path)!r} is not TOML: {error}") from error


def _jobs(study: dict[str, Any], folder: Path, faults: list[str]) -> Jobs:
    """The jobs that can be made; `faults` gets what is wrong with the others."""
    common, tables = study.pop("common", {}), study.pop("job", [])
    faults += [f"{key} is unknown; allowed are common, job" for key in study]
    if not isinstance(common, dict):
        faults.append("common must be a table [common]")
        common = {}
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        faults.append("job must be tables [[job]]")
        tables = []
    elif not tables:
        faults.append("job is missing: there must be at least one table [[job]]")
    used: set[str] = set()
    jobs: Jobs = {}
    for number, table in enumerate(tables, 1):
        kind = table.get("command")
        if not isinstance(kind, str) or kind not in COMMANDS:
            got = repr(kind)[:60] if "command" in table else f"only {', '.join(table) or 'nothing'}"
            allowed = ", ".join(COMMANDS)
            faults.append(f"job {number}: command must be one of {allowed}, got {got}")
            continue
        name, types = f"job {number} ({kind})", _types(COMMANDS[kind])
        used |= types.keys()
        shared = {key: value for key, value in common.items() if _option(key) in types}
        own = {key: value for key, value in table.items() if key != "command"}
        before = len(faults)
        options = _converted(shared, types, f"{name}: common: ", faults)
        options |= _converted(own, types, f"{name}: ", faults)
        if len(faults) == before:
            command = COMMANDS[kind](**options)
            paths = {name: type(path)(folder / path) for name, path in command.paths().items()}
            jobs[name] = replace(command, **paths)
    faults += [
        f"common: {key} is an option of no job" for key in common if _option(key) not in used
    ]
    return jobs


@functools.cache
def _types(command: type[Command]) -> dict[str, Any]:
    """The types of the options that a job may have, by name."""
    hints = get_type_hints(command)
    names = [field.name for field in fields(command)]
    return {name: hints[name] for name in names if not hasattr(Command, name)}


def _option(key: str) -> str:
    return key.replace("-", "_")


def _converted(
    table: dict[str, Any], types: dict[str, Any], where: str, faults: list[str]
) -> dict[str, Any]:
    """The options of a table in their types; `faults` gets what is wrong with the others."""
    options: dict[str, Any] = {}
    keys: dict[str, str] = {}
    for key, value in table.items():
        option = _option(key)
        if option not in types:
            faults.append(f"{where}{key} is unknown; allowed are {', '.join(types)}")
            continue
        if keys.setdefault(option, key) != key:
            faults.append(f"{where}{key} and {keys[option]} are the same")
        try:
            options[option] = _as(types[option], value)
        except ValueError as error:
            faults.append(f"{where}{key} must be {error}, got {value!r:.60}")
    return options


# How an option is written in TOML: in words, its types there, and what makes the option of it.
_WRITTEN: dict[Any, tuple[str, tuple[type, ...], type]] = {
    float: ("a number", (int, float), float),
    int: ("a whole number", (int,), int),
    bool: ("true or false", (bool,), bool),
    str: ("text", (str,), str),
    Path: ("text", (str,), Path),
    GridValue: ('numbers or "START:STOP:COUNT"', (int, float, str), str),
}


def _as(kind: Any, value: Any) -> Any:
    """A value of a study as the type of an option; a `ValueError` says what is allowed."""
    parts = get_args(kind)
    if type(None) in parts:  # an option that may be left out: TOML has no None
        return _as(parts[0], value)
    if get_origin(kind) is tuple:
        return tuple(
            _as(parts[0], each) for each in (value if isinstance(value, list) else [value])
        )
    if get_origin(kind) is Literal:
        if value in parts:
            return value
        raise ValueError(f"one of {', '.join(parts)}")
    allowed, types, convert = _WRITTEN[kind]
    if type(value) not in types:
        raise ValueError(allowed)
    try:
        return convert(value)
    except OverflowError:
        raise ValueError("a number that is not too large") from None


def _collisions(jobs: Jobs) -> Iterator[str]:
    """Faults of jobs whose files are also files of other jobs, or their folders.

    By dictionaries, so that the time is in proportion to the number of jobs.
    """
    files: dict[Path, str] = {}
    folders: dict[Path, str] = {}
    for name, command in jobs.items():
        if isinstance(command, Writing) and command.out is not None:
            folder = command.out.resolve()
            above, own = (folder, *folder.parents), [folder / file for file in command.names]
            taken = {path: files[path] for path in (*above, *own) if path in files}
            taken |= {path: folders[path] for path in own if path in folders}
            for path, other in taken.items():
                yield f"{name}: out: {str(path)!r} is in the way of {other}"
            files.update(dict.fromkeys(own, name))
            folders.update(dict.fromkeys(above, name))
