"""The words of a command line as a command: cyclopts reads them, helps, and says what is wrong."""

from collections.abc import Mapping, Sequence

from cyclopts import App, CycloptsError, Parameter

from ..host import version
from .options import Command


def make_parser(commands: Mapping[str, type[Command]]) -> App:
    """Make a parser of commands, by their names."""
    parser = App(
        name="jaxrock",
        help="Rocking of rigid blocks: will it rock, how far, and what overturns it.",
        version=version,
        default_parameter=Parameter(
            negative="", consume_multiple=True, show_default=write_default
        ),
        help_format="markdown",
    )
    for name, command in commands.items():
        parser.command(command, name=name)
    parser.register_install_completion_command()
    return parser


def write_default(value: object) -> str | None:
    """Write a default as it would be typed; None for what is not given by default."""
    if isinstance(value, tuple):
        return " ".join(str(write_default(each)) for each in value) or None
    if isinstance(value, float):
        return f"{value:.6g}"
    return None if value is None or value is False else str(value)


def read_words(parser: App, words: Sequence[str]) -> Command:
    """Read the name of a command and its options.

    Raises
    ------
    SystemExit
        After help or the version, which have been printed.
    ValueError
        If the words are no command, with one sentence that says why.
    """
    if not words:
        raise ValueError("a command must be given; --help lists them")
    try:
        make, given, _ = parser.parse_args(words, print_error=False, exit_on_error=False)
    except CycloptsError as error:
        raise ValueError(str(error)) from None
    command = make(*given.args, **given.kwargs)
    if not isinstance(command, Command):
        raise SystemExit(0)
    return command
