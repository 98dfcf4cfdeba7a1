"""The command line: `motm-twin serve | run | record | replay | rerun | what-if | scene | bench | ...`."""

import io
import os
import sys

import tyro

from motm_twin import __version__
from motm_twin.bus.connection import ConfigError
from motm_twin.cli.commands import COMMANDS
from motm_twin.cli.outputs import kernel_problem
from motm_twin.model.names import MethodError, SceneError, hint
from motm_twin.program import BAD_INPUT, FAILED, INTERRUPTED, OK, plain_console
from motm_twin.sessions.session import SessionError


def main() -> None:
    """Run the command line and exit with the command's code; 1 when the output is closed, 130 after Ctrl-C."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal that knows ASCII only, as over a serial line
    try:
        try:
            code = _called()
        finally:
            sys.stdout.flush()  # a closed output shows here at the latest
    except BrokenPipeError:  # "Note on SIGPIPE" of Python's signal: what is left must not be written at the end again
        _give_up_output()
        code = FAILED
    except OSError as error:
        if not _output_fails():
            raise
        _give_up_output()
        print(f"motm-twin: standard output cannot be written: {error.strerror or error}", file=sys.stderr)
        code = BAD_INPUT
    except KeyboardInterrupt as stopped:
        print("; ".join(["motm-twin: stopped", *stopped.args]), file=sys.stderr)
        code = INTERRUPTED
    sys.exit(code)


def _output_fails() -> bool:
    """Standard output cannot be written, as on a full disk."""
    try:
        sys.stdout.flush()
        return os.write(sys.stdout.fileno(), b"") < 0
    except OSError:
        return True


def _give_up_output() -> None:
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _called() -> int:
    """The exit code of the command."""
    if sys.argv[1:] == ["--version"]:
        print(f"motm-twin {__version__}")
        return OK
    wrong = sys.argv[1] if len(sys.argv) > 1 else ""
    if wrong and not wrong.startswith("-") and wrong not in COMMANDS:
        print(f"motm-twin: there is no command {wrong!r}; {hint(wrong, COMMANDS)}", file=sys.stderr)
        return BAD_INPUT
    try:
        return tyro.extras.subcommand_cli_from_dict(
            COMMANDS,
            prog="motm-twin",
            description="Reactive manipulation on the move, as a digital twin. --version prints the version.",
        )
    except (SceneError, SessionError, ConfigError, MethodError) as error:
        return _refused(str(error))
    except RuntimeError:  # of Numba, when a module with kernels is imported
        if problem := kernel_problem():
            return _refused(problem)
        raise


def _refused(problem: str) -> int:
    plain_console(stderr=True).print(f"motm-twin: {problem}", markup=False)
    return BAD_INPUT
