"""``jaxrock run study.toml``: several commands from one file."""

import difflib
import functools
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import field, replace
from pathlib import Path

from ..host import read_regular, show_progress
from .arguments import make_parser, read_words
from .command import Answer, Command, Steps, Writing
from .commands import COMMANDS

_PARSER = make_parser(COMMANDS)  # without `run`: a study contains no studies

Table = dict[str, object]  # of TOML
Jobs = dict[str, Command]  # by the names that errors and answers give them


class Run(Command):
    """Run the jobs of a study file, all of them checked before the first one starts.

    A study is a TOML file with a table [[job]] for each: its command and that command's
    options, written with dashes or underscores; grids are numbers, lists or
    "START:STOP:COUNT". Options in a table [common] hold for every job that has them. Paths
    start at the folder of the study. A job that fails does not keep the others from running.

    Example: jaxrock run study.toml
    """

    command = "run"

    study: Path = field(kw_only=False)
    """The study file."""

    # Kept, since a job that was checked has read its records, and need not read them again to
    # run.
    @functools.cached_property
    def jobs(self) -> Jobs:
        """The jobs, checked; a `ValueError` names all faults of the study."""
        faults: list[str] = []
        jobs = _make_jobs(_read_study(self.study), self.study.parent, faults)
        faults += _find_collisions(jobs)
        if faults:
            raise ValueError(
                "\n  ".join([f"{self.study} cannot be run:", *dict.fromkeys(faults)])
            )
        return jobs

    def _carry_out(self) -> Steps:
        jobs = self.jobs
        answers = list[tuple[str, Answer]]()
        yield ()
        for name, command in show_progress(jobs.items(), "jobs"):
            # Ctrl-C is none of these: it ends the study, and not only a job of it.
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


def _read_study(path: Path) -> Table:
    """Read a study file."""
    try:
        # Editors on Windows put a byte order mark first, which TOML does not allow.
        return tomllib.loads(read_regular(path).decode("utf-8-sig"))
    except OSError as error:
        raise ValueError(f"study: {str(path)!r} cannot be read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"study: {str(path)!r} is not TOML: {error}") from error
    # The parser of Python calls itself for every bracket.
    except RecursionError:
        raise ValueError(f"study: {str(path)!r} is nested too deeply") from None


def _make_jobs(study: Table, folder: Path, faults: list[str]) -> Jobs:
    """Make the jobs that can be made, and append the faults of the others to `faults`."""
    # A mistake in the outline is noted, and the rest is looked at all the same: a user sees
    # all faults at once.
    common = study.pop("common", {})
    tables = study.pop("job", [])
    faults += [f"{key} is unknown; allowed are common, job" for key in study]
    if not isinstance(common, dict):
        faults.append("common must be a table [common]")
        common = {}
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        faults.append("job must be tables [[job]]")
        tables = []
    elif not tables:
        faults.append("job is missing: there must be at least one table [[job]]")
    # A common option that no job has is a misspelling.
    unused = dict(common)
    jobs = Jobs()
    # Each job is checked, which reads its records: with many jobs it takes a while.
    for number, table in show_progress(list(enumerate(tables, 1)), "checking jobs"):
        kind = table.pop("command", None)
        if not isinstance(kind, str) or kind not in COMMANDS:
            got = f"only {', '.join(table) or 'nothing'}" if kind is None else repr(kind)[:60]
            must = f"command must be one of {', '.join(COMMANDS)}"
            faults.append(f"job {number}: {must}, got {got}{_suggest_name(kind, COMMANDS)}")
            continue
        name = f"job {number} ({kind})"
        options = COMMANDS[kind].name_options()
        shared = {key: value for key, value in common.items() if _name_option(key) in options}
        unused = {key: value for key, value in unused.items() if key not in shared}
        try:
            job = _make_job(kind, shared, table, folder)
            job.check()
            jobs[name] = job
        except ValueError as error:
            faults.append(f"{name}: {error}")
    known = {name for kind in COMMANDS.values() for name in kind.name_options()}
    for key in unused:
        hint = _suggest_name(_name_option(key), known)
        faults.append(f"common: {key} is an option of no job{hint}")
    return jobs


def _suggest_name(given: object, known: Iterable[str]) -> str:
    """Suggest the name that was likely meant; empty if none is near."""
    near = difflib.get_close_matches(str(given), sorted(known), 1)
    return f'. Did you mean "{near[0]}"?' if near else ""


def _make_job(kind: str, common: Table, table: Table, folder: Path) -> Command:
    """Make a command from the options of a job, which are read as words of a command line."""
    options = Table()
    # The options of a job come last, and so replace common ones.
    for given in (common, table):
        named = {_name_option(key): value for key, value in given.items()}
        if len(named) < len(given):
            raise ValueError("an option is given twice, with dashes and with underscores")
        options |= named
    # These would end or change the command `run` itself.
    for name in ("help", "json", "no_cache", "version"):
        if name in options:
            raise ValueError(f"{name} is no option of a job")
    words = [word for name, value in options.items() for word in _write_words(name, value)]
    job = read_words(_PARSER, [kind, *words])
    # Record files are text, which may be "example": a path stays of the type that it had.
    return replace(
        job, **{name: type(path)(folder / path) for name, path in job.find_paths().items()}
    )


def _write_words(name: str, value: object) -> list[str]:
    """Write an option of a study as words of a command line."""
    # A flag has no value: it is there or not. An empty list is refused by the command itself.
    option = f"--{name.replace('_', '-')}"
    if value is False:
        return []
    if value is True or value == []:
        return [option]
    # With "=" a value that begins with a dash, as a negative number, is no option.
    values = value if isinstance(value, list) else [value]
    return [f"{option}={each}" for each in values]


def _name_option(key: str) -> str:
    """Name the option that a key of a study means."""
    return key.replace("-", "_")


def _find_collisions(jobs: Jobs) -> Iterator[str]:
    """Find the jobs whose files are also files of other jobs, or their folders.

    All paths stand in dictionaries, so that the time is in proportion to the number of jobs.
    """
    files: dict[Path, str] = {}
    folders: dict[Path, str] = {}
    for name, command in jobs.items():
        if isinstance(command, Writing) and command.targets:
            # Resolved: the same folder may be named by ".." or by a link.
            own = [path.resolve() for path in command.targets]
            above = (own[0].parent, *own[0].parent.parents)
            # A file of another job where this one has a file or a folder; a folder of another
            # job where this one has a file.
            taken = {path: files[path] for path in (*above, *own) if path in files}
            taken |= {path: folders[path] for path in own if path in folders}
            for path, other in taken.items():
                yield f"{name}: out: {str(path)!r} is in the way of {other}"
            files.update(dict.fromkeys(own, name))
            folders.update(dict.fromkeys(above, name))
