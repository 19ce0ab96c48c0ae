"""The words of a command line as a command: what help says, and what is wrong in one sentence."""

import ast
import contextlib
import dataclasses
import difflib
import functools
import inspect
import io
import re
import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import NoneType
from typing import Any, Literal, NamedTuple, cast, get_args, get_origin

import tyro

from .commands import COMMANDS
from .options import BlockOptions, Command, GridValue, MotionOptions, Writing
from .storing import Storing
from .study import Run, as_type, types_of

_COMMANDS: dict[str, type[Command]] = {**COMMANDS, "run": Run}
_ABOUT = "Rocking of rigid blocks: will it rock, how far, and what overturns it."
_GROUPS = {"block": BlockOptions, "ground motion": MotionOptions, "output": Writing}
_GROUPS["a store"] = Storing
_GROUP_OF = {key: title for title, of in [*_GROUPS.items()][::-1] for key in types_of(of)}
_PLACES = {bool: "", float: "NUMBER", int: "COUNT", str: "TEXT", Path: "PATH", GridValue: "NUMBER"}


class _Option(NamedTuple):
    """What a command may be given: --name, or NAME for what stands alone."""

    name: str
    kind: Any  # type of each word
    many: bool  # whether it takes any number of them
    group: str
    label: str  # in help, with what stands for its words
    help: str

    def faults(self, word: str | None) -> Iterator[str]:
        """What is wrong with a word, or with none."""
        try:
            as_type(self.kind, word, from_word=word is not None)
        except ValueError as error:
            got = "nothing" if word is None else f"{word!r:.60}"
            yield f"{self.name} must be {error}, got {got}"


def command_of(arguments: Sequence[str]) -> Command:
    """The command; `SystemExit` after help, a `ValueError` of one sentence for what is wrong."""
    if {"-h", "--help"} & {*arguments}:
        print(_help(arguments[0]))
        raise SystemExit(0)
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            return tyro.extras.subcommand_cli_from_dict(
                _COMMANDS, prog="jaxrock", args=arguments, config=(tyro.conf.FlagCreatePairsOff,)
            )
    except SystemExit as stop:
        if not stop.code:  # after a script for completion
            raise
    words = re.sub(r"[\u2500-\u257f]|\x1b\[[\d;]*m", " ", said.getvalue()).split()
    raise ValueError(next(_faults(*arguments), " ".join(words)))


def _faults(name: str = "", *words: str) -> Iterator[str]:
    """What is wrong with the words after ``jaxrock``, each in one sentence."""
    if name not in _COMMANDS:
        yield f"command must be one of {', '.join(_COMMANDS)}, got {repr(name) if name else 'none'}"
        return
    alone, options = _options_of(_COMMANDS[name])
    left, option, room = list[str](), None, 0
    for word, after in zip(words, (*words[1:], "--"), strict=False):
        if word.startswith("--"):
            given, equals, value = word.partition("=")
            given = given.replace("_", "-")
            if given not in options:
                nearest = difflib.get_close_matches(given, options, 1)
                perhaps = f"perhaps {nearest[0]} is meant" if nearest else "--help lists them"
                yield f"{given} is no option of {name}, {perhaps}"
                return
            option = options[given]
            room = 0 if equals or option.kind is bool else len(words) if option.many else 1
            if equals or (room == 1 and after.startswith("--")):
                yield from option.faults(value if equals else None)
        elif room and option:
            room -= 1
            yield from option.faults(word)
        else:
            left.append(word)
    for word in left[len(alone) :]:
        yield f"{word!r:.60} belongs to no option of {name}, each of which begins with --"
    for missing in alone[len(left) :]:
        yield f"{missing.name} must be given to {name}: {missing.help}"


@functools.cache
def _options_of(command: type[Command]) -> tuple[list[_Option], dict[str, _Option]]:
    """What stands alone, and the options by name."""
    types, helps = {**types_of(command), "as_json": bool, "no_cache": bool}, _helps(command)
    alone, options = list[_Option](), dict[str, _Option]()
    for field in dataclasses.fields(command):
        kind = types[field.name]
        kind = get_args(kind)[0] if NoneType in get_args(kind) else kind
        many, text, default = get_origin(kind) is tuple, helps[field.name], field.default
        kind = get_args(kind)[0] if many else kind
        if default is dataclasses.MISSING:
            name = field.name.upper()
            alone.append(_Option(name, kind, many, "alone", name, text))
            continue
        if default is not None and kind is not bool:
            values = default if isinstance(default, tuple) else [default]
            words = [f"{each:.6g}" if isinstance(each, float) else str(each) for each in values]
            text += f" (default: {' '.join(words)})"
        name = "--" + field.name.removeprefix("as_").replace("_", "-")
        group = _GROUP_OF.get(field.name, "output" if hasattr(Command, field.name) else "")
        choices = get_origin(kind) is Literal
        place = f"{{{','.join(get_args(kind))}}}" if choices else _PLACES[kind]
        label = f"{name} {place}{' ...' * many}".strip()
        options[name] = _Option(name, kind, many, group, label, text)
    return alone, options


def _helps(command: type[Command]) -> dict[str, str]:
    """What the source says of each option, beside it or below it."""
    helps: dict[str, str] = {}
    for each in command.__mro__[-3::-1]:  # but for `object` and `abc.ABC`
        source = inspect.getsource(each)
        tree: Any = ast.parse(source)
        lines, body = source.splitlines(), tree.body[0].body
        for node, below in zip(body, [*body[1:], None], strict=True):
            if isinstance(node, ast.AnnAssign):
                field, after = cast("Any", (node, below))
                beside = lines[field.end_lineno - 1][field.end_col_offset :].strip(" #")
                text = after.value.value if isinstance(below, ast.Expr) else beside
                helps |= {field.target.id: " ".join(text.split())} if text else {}
    return helps


def _help(name: str) -> str:
    if name not in _COMMANDS:
        firsts = {each: str(of.__doc__).partition("\n")[0] for each, of in _COMMANDS.items()}
        parts = ["usage: jaxrock COMMAND [OPTIONS]", _ABOUT, _columns(firsts)]
        return "\n\n".join([*parts, "jaxrock COMMAND --help says more about a command."])
    alone, options = _options_of(_COMMANDS[name])
    usage = " ".join(["usage: jaxrock", name, *(each.name for each in alone), "[OPTIONS]"])
    parts = [usage, str(inspect.getdoc(_COMMANDS[name]))]
    for group in ("alone", "", *_GROUPS):
        pairs = {o.label: o.help for o in (*alone, *options.values()) if o.group == group}
        title = "" if group == "alone" else f"{group or f'options of {name}'}:\n"
        parts += [title + _columns(pairs)] if pairs else []
    return "\n\n".join(parts)


def _columns(pairs: dict[str, str]) -> str:
    """Two columns, the second one wrapped; it begins below what is long in the first."""
    rows = []
    for first, text in pairs.items():
        lines = textwrap.wrap(text, 74)
        rows.append(f"  {first:<23} {lines.pop(0) if len(first) < 24 else ''}".rstrip())
        rows += [f"{'':26}{line}" for line in lines]
    return "\n".join(rows)
