"""The command line: all subcommands, run with one clear message for each way that they can end."""

from __future__ import annotations

import os
import signal
import sys
from contextlib import suppress
from contextvars import copy_context
from copy import copy
from difflib import get_close_matches

import typer

from ensemble_ctrl.cli import codes, plans, ranges, tools
from ensemble_ctrl.cli.memory import MemoryLimitError
from ensemble_ctrl.cli.root import NAME, UsageError, app
from ensemble_ctrl.cli.streams import OutputError, complain, fail, fail_with, keep_standard_streams, silence
from ensemble_ctrl.cli.watcher import forget_after_one
from ensemble_ctrl.core.errors import EnsembleError, WorkerError

__all__ = ["NAME", "app", "invoke", "main", "plans", "ranges", "tools", "with_command"]

COMPLETING = "_ENSEMBLE_PLAN_COMPLETE"
"""Set by a shell's completion script."""


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit; a user's mistake is one clear message, never a traceback."""
    keep_standard_streams()
    forget_after_one(signal.SIGINT)
    with suppress(AttributeError, ValueError):
        sys.stdout.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]
    sys.exit(invoke(list(sys.argv[1:] if arguments is None else arguments)))


def invoke(arguments: list[str]) -> int:
    """Run the command line; returns the exit code."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "1")  # looking for them reads every installed package's metadata
    if COMPLETING in os.environ:
        return _complete()
    as_json = "--json" in arguments
    return copy_context().run(_invoked, arguments, as_json)


def _invoked(arguments: list[str], as_json: bool) -> int:
    """The command line in a context of its own, so that a consent ends with it."""
    try:
        words = with_command(arguments)
        command = typer.main.get_command(_with_one(words[0]) if words and words[0] in _command_names() else app)
        with command.make_context(NAME, words, obj=tuple(arguments)) as context:
            return int(command.invoke(context) or 0)
    except typer.Exit as end:
        return int(end.exit_code)
    except KeyboardInterrupt:
        return fail(codes.INTERRUPTED, "interrupted; there is no plan yet", as_json)
    except BrokenPipeError:  # while the help was printed
        silence()
        return codes.OK
    except OutputError as error:
        complain(f"error: {error}")
        return codes.INTERNAL
    except (MemoryLimitError, WorkerError) as error:
        return fail_with(codes.INTERNAL, error, as_json)
    except EnsembleError as error:
        return fail_with(codes.USAGE, error, as_json)
    except MemoryError:
        return fail(codes.INTERNAL, "out of memory; fewer members, steps or obstacles need less", as_json)
    except OSError as error:
        silence()
        return fail(codes.INTERNAL, f"{error.filename or 'output'}: {error.strerror or error}", as_json)
    except Exception as error:
        return _unexpected(error, as_json)


def _complete() -> int:
    """Tell the shell what could come next, also after a problem file that stands where a command could."""
    typed, place = os.environ.get("COMP_WORDS", ""), os.environ.get("COMP_CWORD", "")
    words = typed.split()
    if place.isdecimal() and int(place) > 1 and words[1:] and words[1] not in _command_names():
        os.environ["COMP_WORDS"] = typed.replace(words[0], f"{words[0]} run", 1)
        os.environ["COMP_CWORD"] = str(int(place) + 1)
    try:
        app(prog_name=NAME)
    except SystemExit as end:
        return int(end.code or 0)
    return codes.OK


def with_command(arguments: list[str]) -> list[str]:
    """Put ``run`` before a problem file that stands where a command could; ``./check`` is a file.

    Raises
    ------
    UsageError
        If there is no such file, and the word is much like a command's name.
    """
    commands = _command_names()
    first = arguments[0] if arguments else ""
    own = ("-h", "--help", "--version", "--install-completion", "--show-completion")
    if not first or first in (*commands, *own):
        return arguments
    close = get_close_matches(first, commands, n=1, cutoff=0.65)
    if close and first.isalpha() and not os.path.exists(first):
        raise UsageError(f"{first}: there is no such command or file; did you mean {close[0]!r}?")
    return ["run", *arguments]


def _command_names() -> list[str]:
    """Every command, in the order of the help."""
    return [_name_of(command) for command in app.registered_commands]


def _name_of(command: typer.models.CommandInfo) -> str:
    """A command's name."""
    return command.name or str(getattr(command.callback, "__name__", ""))


def _with_one(name: str) -> typer.Typer:
    """The command line with one of its commands: to build the parser of each takes as long as to import NumPy."""
    one = copy(app)
    one.registered_commands = [each for each in app.registered_commands if _name_of(each) == name]
    return one


def _unexpected(error: Exception, as_json: bool) -> int:
    """What the parser of the command line found, or a mistake of ours."""
    if hasattr(error, "format_message"):
        return _usage(error, as_json)
    if os.environ.get("ENSEMBLE_PLAN_DEBUG"):
        raise error
    text = f"internal error: {type(error).__name__}: {error} (set ENSEMBLE_PLAN_DEBUG=1 for the traceback)"
    return fail(codes.INTERNAL, text, as_json)


def _usage(error: Exception, as_json: bool) -> int:
    """A wrong option or argument; without any, this is the help."""
    message = str(error.format_message())  # type: ignore[attr-defined]
    context = getattr(error, "ctx", None)
    if message.startswith("Usage:"):
        complain(message)
    else:
        message = message[:1].lower() + message[1:].rstrip(".")
        fail(codes.USAGE, message, as_json)
        complain(f"try '{context.command_path if context else NAME} --help'")
    return codes.USAGE
