"""Run a command of jaxrock in this process."""

from jaxrock.cli import main


def run(capsys, *arguments):
    """Exit code, standard output, standard error."""
    try:
        main([str(argument) for argument in arguments])
        code = 0
    except SystemExit as stop:
        code = stop.code
    captured = capsys.readouterr()
    return code, captured.out, captured.err
