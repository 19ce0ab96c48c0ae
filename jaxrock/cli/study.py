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
from .options import Answer, Command, GridValue, Steps, Writing

Table = dict[str, Any]  # of TOML
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

    @functools.cached_property
    def jobs(self) -> Jobs:
        """The jobs, checked; a `ValueError` names all faults of the study."""
        faults: list[str] = []
        jobs = _jobs(_read(self.study), self.study.parent, faults)
        faults += _collisions(jobs)
        if faults:
            raise ValueError("\n  ".join([f"{self.study} cannot be run:", *dict.fromkeys(faults)]))
        return jobs

    def _steps(self) -> Steps:
        jobs, answers = self.jobs, list[tuple[str, Answer]]()
        yield ()
        for name, command in with_progress(jobs.items(), "jobs"):
            try:
                answer = command.run()
            except (ValueError, OSError, MemoryError) as error:
                said = [f"{self.study}: {name}: {error}"]
                answer = Answer(f"error: {error}", {"error": str(error)}, 2, said)
            answers.append((name, answer))
        return Answer(
            "\n\n".join(f"{name}\n{answer.text}" for name, answer in answers),
            {"jobs": [{"job": name, "code": a.code, **a.data} for name, a in answers]},
            max(answer.code for _, answer in answers),
            [error for _, answer in answers for error in answer.errors],
        )


def _read(path: Path) -> Table:
    try:
        return tomllib.loads(read_regular(path).decode("utf-8-sig"))
    except OSError as error:
        raise ValueError(f"study: {str(path)!r} cannot be read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"study: {str(path)!r} is not TOML: {error}") from error
    except RecursionError:
        raise ValueError(f"study: {str(path)!r} is nested too deeply") from None


def _jobs(study: Table, folder: Path, faults: list[str]) -> Jobs:
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
    unused, jobs = dict(common), Jobs()
    for number, table in with_progress(list(enumerate(tables, 1)), "checking jobs"):
        kind = table.pop("command", None)
        if not isinstance(kind, str) or kind not in COMMANDS:
            got = f"only {', '.join(table) or 'nothing'}" if kind is None else repr(kind)[:60]
            allowed = ", ".join(COMMANDS)
            faults.append(f"job {number}: command must be one of {allowed}, got {got}")
            continue
        name, types = f"job {number} ({kind})", types_of(COMMANDS[kind])
        unused = {key: value for key, value in unused.items() if _option(key) not in types}
        try:
            job = _job(COMMANDS[kind], table, common, folder)
            job.check()
            jobs[name] = job
        except ValueError as error:
            faults += [f"{name}: {fault}" for fault in str(error).splitlines()]
    faults += [f"common: {key} is an option of no job" for key in unused]
    return jobs


def _job(command: type[Command], table: Table, common: Table, folder: Path) -> Command:
    """A command with the options of a job; a `ValueError` names all faults of these."""
    types = types_of(command)
    given = [("common: ", key, common[key]) for key in common if _option(key) in types]
    given += [("", key, value) for key, value in table.items()]
    options, keys, faults = Table(), dict[tuple[str, str], str](), list[str]()
    for where, key, value in given:
        option = _option(key)
        if option not in types:
            faults.append(f"{where}{key} is unknown; allowed are {', '.join(types)}")
        elif keys.setdefault((where, option), key) != key:
            faults.append(f"{where}{key} and {keys[where, option]} are the same")
        else:
            try:
                options[option] = as_type(types[option], value)
            except ValueError as error:
                faults.append(f"{where}{key} must be {error}, got {value!r:.60}")
    if faults:
        raise ValueError("\n".join(faults))
    job = command(**options)
    return replace(job, **{name: type(path)(folder / path) for name, path in job.paths().items()})


@functools.cache
def types_of(command: type[Command]) -> dict[str, Any]:
    """The types of the options that a job may have, by name."""
    hints = get_type_hints(command)
    names = [field.name for field in fields(command)]
    return {name: hints[name] for name in names if not hasattr(Command, name)}


def _option(key: str) -> str:
    return key.replace("-", "_")


# How an option is written in TOML: in words, its types there, and what makes the option of it.
_WRITTEN: dict[Any, tuple[str, tuple[type, ...], type]] = {
    float: ("a number", (int, float), float),
    int: ("a whole number", (int,), int),
    bool: ("true or false", (bool,), bool),
    str: ("text", (str,), str),
    Path: ("text", (str,), Path),
    GridValue: ('numbers or "START:STOP:COUNT"', (int, float, str), str),
}


def as_type(kind: Any, value: Any, from_word: bool = False) -> Any:
    """A value of a study as the type of an option; a `ValueError` says what is allowed.

    From a word of a command line it is converted, whatever type it would have in TOML.
    """
    parts = get_args(kind)
    if type(None) in parts:  # an option that may be left out: TOML has no None
        return as_type(parts[0], value)
    if get_origin(kind) is tuple:
        values = value if isinstance(value, list) else [value]
        return tuple(as_type(parts[0], each) for each in values)
    if get_origin(kind) is Literal:
        if value in parts:
            return value
        raise ValueError(f"one of {', '.join(parts)}")
    allowed, types, convert = _WRITTEN[kind]
    if type(value) not in types and not from_word:
        raise ValueError(allowed)
    try:
        return convert(value)
    except OverflowError:
        raise ValueError("a number that is not too large") from None
    except ValueError:
        raise ValueError(allowed) from None


def _collisions(jobs: Jobs) -> Iterator[str]:
    """Faults of jobs whose files are also files of other jobs, or their folders.

    By dictionaries, so that the time is in proportion to the number of jobs.
    """
    files: dict[Path, str] = {}
    folders: dict[Path, str] = {}
    for name, command in jobs.items():
        if isinstance(command, Writing) and command.targets:
            own = [path.resolve() for path in command.targets]
            above = (own[0].parent, *own[0].parent.parents)
            taken = {path: files[path] for path in (*above, *own) if path in files}
            taken |= {path: folders[path] for path in own if path in folders}
            for path, other in taken.items():
                yield f"{name}: out: {str(path)!r} is in the way of {other}"
            files.update(dict.fromkeys(own, name))
            folders.update(dict.fromkeys(above, name))
