"""Errors of wrong calls: they name options as typed, and say what to type instead."""

import contextlib
import difflib
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Literal, get_args, get_origin

from cyclopts import (
    App,
    Argument,
    CoercionError,
    CycloptsError,
    MissingArgumentError,
    RepeatArgumentError,
    Token,
    UnknownCommandError,
    UnknownOptionError,
    UnusedCliTokensError,
)

from ..tables import parse_unit

# The options that numbers without options are likely meant for.
_SIZES = ("--width", "--height")
# What may stand before the subject of a sentence: a file, and perhaps a line of it.
_PLACE = r"^(?:'[^'\n]*'(?:, line \d+)?: )?"
# What follows a subject; without it the word is no argument, as in "samples in time".
_VERB = r"(?:must|has|have|is|are|goes|go|excludes?)\b"


def name_arguments(text: str, names: Mapping[str, str]) -> str:
    """Write other names for arguments, where these are the subject of a sentence.

    An argument such as ``width`` is also a word, which stays as it is elsewhere in the text.
    """
    words = "|".join(map(re.escape, sorted(names, key=len, reverse=True)))
    subject = rf"(?:{words})(?![\w-])"
    subjects = rf"{_PLACE}(?:{subject})(?:(?:, | and | or ){subject})*(?= {_VERB}|:)"
    obliged = rf"(?<![\w-])(?:{words})(?= must )"

    def replace(match: re.Match[str]) -> str:
        """Write the other name of each argument, outside of quotation marks."""
        parts = re.split(r"('[^']*')", match[0])
        parts[::2] = [
            re.sub(rf"(?<![\w-])(?:{words})(?![\w-])", lambda name: names[name[0]], part)
            for part in parts[::2]
        ]
        return "".join(parts)

    return re.sub(rf"{subjects}|{obliged}", replace, text, flags=re.MULTILINE)


@contextlib.contextmanager
def naming_arguments(**names: str) -> Iterator[None]:
    """Let errors of the library name options, where arguments have other names than these."""
    try:
        yield
    except ValueError as error:
        raise ValueError(name_arguments(str(error), names)) from error


def name_options(text: str, command: App) -> str:
    """Write the options of a command as they are typed, in an error of the library."""
    options = {
        argument.field_info.name: argument.name
        for argument in _list_arguments(command)
        if not _is_positional(argument)
    }
    return name_arguments(text, options)


def describe_wrong_call(error: CycloptsError, words: Sequence[str], application: App) -> str:
    """Describe what cyclopts could not read, and what to type instead."""
    if isinstance(error, UnknownCommandError) or not error.command_chain:
        return _describe_command(words[0], application)
    name = error.command_chain[0]
    arguments = _list_arguments(application[name])
    if isinstance(error, UnknownOptionError):
        return _describe_option(name, error.token.keyword or error.token.value, arguments)
    if isinstance(error, UnusedCliTokensError):
        return _describe_leftovers(name, error.unused_tokens or [], words, arguments)
    if isinstance(error, RepeatArgumentError):
        return f"{error.token.keyword} must be given once, got it again: {error.token.value}"
    if isinstance(error, MissingArgumentError) and error.argument is not None:
        return _describe_missing(name, error.argument, words, arguments)
    if isinstance(error, CoercionError) and error.token is not None:
        return _describe_value(error, error.token, arguments)
    return str(error)


def _describe_value(error: CoercionError, token: Token, arguments: Iterable[Argument]) -> str:
    """Describe the value of an option that is none of those it can have."""
    if get_origin(error.target_type) is Literal:
        choices = get_args(error.target_type)
        near = _find_near(token.value.lower().replace("_", "-"), choices)
        meant = f"; did you mean {near}?" if near else ""
        allowed = f"one of {', '.join(choices)}"
        return f"{token.keyword} must be {allowed}, got {token.value!r}{meant}"
    if error.target_type is int:
        return f"{token.keyword} must be a whole number, got {token.value!r}"
    if error.target_type is float:
        unit = _find_unit(f"{token.keyword}", arguments)
        allowed = f"a number in {unit}" if unit else "a number"
        hint = suggest_number(token.value, unit)
        return f"{token.keyword} must be {allowed}, got {token.value!r}{hint}"
    return str(error)


def suggest_number(word: str, unit: str = "") -> str:
    """Say how to write what is meant for a number; empty if that is not clear."""
    if re.fullmatch(r"[-+]?\d*,\d+", word):
        return f"; write it with a decimal point: {word.replace(',', '.')}"
    if re.fullmatch(r"[-+]?[\d.]+(,[-+]?[\d.]+)+", word):
        return f"; write spaces between numbers: {word.replace(',', ' ')}"
    if re.fullmatch(r"[-+]?[\d.]+\s*%", word):
        with contextlib.suppress(ValueError):
            return f"; write the fraction: {float(word.rstrip('% ')) / 100:g}"
    if match := re.fullmatch(r"([-+]?[\d.]+)\s*([a-z]\S*)", word, re.I):
        meant = parse_unit(unit)
        given = parse_unit(match[2])
        with contextlib.suppress(ValueError):
            if given.dimension and given.dimension == meant.dimension:
                return f"; type {float(match[1]) * given.factor / meant.factor:.6g}"
    return ""


def _list_arguments(command: App) -> list[Argument]:
    """List the options and the file of a command, with their help."""
    collection = command.assemble_argument_collection(parse_docstring=True)
    return [argument for argument in collection if argument.name != "*"]


def _is_positional(argument: Argument) -> bool:
    """Return whether an argument is given without the name of an option: the file."""
    return argument.field_info.name == "file"


def _find_unit(option: str, arguments: Iterable[Argument]) -> str:
    """Find the unit of an option in its help; empty if it has none."""
    unit = re.search(r"\[([^\]-][^\]]*)\]", _find_help(option, arguments))
    return unit[1] if unit else ""


def _find_help(option: str, arguments: Iterable[Argument]) -> str:
    """Find the help of an option, which an argument of an error does not have."""
    texts = (argument.parameter.help for argument in arguments if argument.name == option)
    return next(texts, None) or ""


def _describe_command(word: str, application: App) -> str:
    """Describe a word that is no command."""
    if word.startswith("-"):
        return f"the command must come first, got {word!r}; jaxrock --help lists the commands"
    names = [name for name in application if not name.startswith("-")]
    near = _find_near(word.lower().replace("_", "-"), names)
    meant = f"; did you mean {near}?" if near else "; jaxrock --help lists the commands"
    return f"there is no command {word!r}{meant}"


def _describe_option(command: str, word: str, arguments: Iterable[Argument]) -> str:
    """Describe an option that a command does not have."""
    names = [argument.name for argument in arguments if not _is_positional(argument)]
    near = _find_near(word.lstrip("-"), [name.lstrip("-") for name in names])
    meant = (
        f"did you mean --{near}?" if near else f"jaxrock {command} --help lists its options"
    )
    return f"{command} has no option {word}; {meant}"


def _find_near(word: str, names: Sequence[str]) -> str | None:
    """Find the name that was likely meant: it begins like the word, or resembles it."""
    begin = [name for name in names if name.startswith(word)]
    if len(begin) == 1 or (begin and len(word) == 1):
        return begin[0]
    return next(iter(difflib.get_close_matches(word, names, n=1, cutoff=0.75)), None)


def _describe_leftovers(
    command: str, leftovers: Sequence[str], words: Sequence[str], arguments: Sequence[Argument]
) -> str:
    """Describe words that belong to no option."""
    given = " ".join(leftovers)
    names = {argument.name: argument for argument in arguments}
    # The same word may also stand behind an option, as its value.
    places = [k for k, word in enumerate(words) if word == leftovers[0]]
    free = [k for k in places if words[k - 1] not in names]
    before = words[: (free or places)[0]]
    last = next((word for word in reversed(before) if word in names), None)
    if last is not None:
        # Behind an option whose values have been read.
        takes_none = names[last].hint is bool
        return (
            f"{last} takes {'no value' if takes_none else 'one value'}, got {given} after it"
        )
    typed_names = {word.partition("=")[0] for word in words}
    options = [name for name in _SIZES if name in names and name not in typed_names]
    example = "write a value after the name of its option"
    if any(_is_positional(argument) for argument in arguments):
        options = ["--hazard"] if "--hazard" in names else []
        example = "write other files after the names of their options"
    if options and len(leftovers) <= len(options):
        typed = zip(options, leftovers, strict=False)
        example += f", such as {' '.join(f'{name} {word}' for name, word in typed)}"
    else:
        example += f"; jaxrock {command} --help lists the options"
    return f"{given} has no option before it: {example}"


def _describe_missing(
    command: str, argument: Argument, words: Sequence[str], arguments: Sequence[Argument]
) -> str:
    """Describe an option without its value, or a file or an option that must be given."""
    about = _find_help(argument.name, arguments).partition(". ")[0].rstrip(".")
    about = about[:1].lower() + about[1:]
    if _is_positional(argument):
        return f"a file must be given: jaxrock {command} FILE, {about}"
    if argument.name in words:
        return f"{argument.name} must have a value: {about}"
    return f"{argument.name} must be given: {about}"
