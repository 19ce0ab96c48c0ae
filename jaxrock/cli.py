"""The command line: ``jaxrock assess``, ``spectrum``, ``respond``, and so on."""

import sys
from collections.abc import Sequence

import jax
import tyro

from .commands import COMMANDS, Command, Run, dumps
from .progress import with_clock


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command; an argument that is not allowed ends it with exit code 2."""
    jax.config.update("jax_enable_x64", True)
    command: Command = tyro.extras.subcommand_cli_from_dict(
        {**COMMANDS, "run": Run},
        prog="jaxrock",
        description="Rocking of rigid blocks: will it rock, how far, and what overturns it.",
        args=arguments,
        config=(tyro.conf.FlagCreatePairsOff,),
    )
    try:
        command.check()
        with with_clock("jaxrock"):
            answer = command.run()
    except ValueError as error:
        print(f"jaxrock: error: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    print(dumps(answer.data) if command.as_json else answer.text)
    for error in answer.errors:
        print(f"jaxrock: error: {error}", file=sys.stderr)
    if answer.code:
        raise SystemExit(answer.code)
