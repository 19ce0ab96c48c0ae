"""Reading of command lines: cyclopts parses the words, shows help, and names faults."""

from collections.abc import Mapping, Sequence

from cyclopts import App, CycloptsError, Parameter

from ..host import read_version
from .command import Command


def make_parser(commands: Mapping[str, type[Command]]) -> App:
    """Make a parser of commands, by their names."""
    parser = App(
        name="jaxrock",
        help="Rocking of rigid blocks: will it rock, how far, and what overturns it.",
        version=read_version,
        # Without `negative`, a flag such as --force has no twin --no-force; there is
        # --no-cache as it is. Lists take all words up to the next option, as in --width 0.4
        # 0.8.
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
    """Write a default as it would be typed; None if there is none to be shown in help."""
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
    # Neither printing nor ending is left to cyclopts: a study collects the faults of all its
    # jobs.
    try:
        make, given, _ = parser.parse_args(words, print_error=False, exit_on_error=False)
    except CycloptsError as error:
        raise ValueError(str(error)) from None
    # Help and the version are functions of cyclopts, which print when they are called.
    command = make(*given.args, **given.kwargs)
    if not isinstance(command, Command):
        raise SystemExit(0)
    return command
