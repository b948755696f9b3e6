"""The command line: subcommands and options; each does its work elsewhere."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated

import typer

from ensemble_ctrl._version import __version__
from ensemble_ctrl.cli import codes
from ensemble_ctrl.cli.streams import complain, fail, fail_with, say, silence
from ensemble_ctrl.errors import EnsembleError

NAME = "ensemble-plan"
EXIT_CODES = """\b
Exit codes:
  0    planned, proven for every member, and no replayed member violates
  1    internal error, or the results could not be written
  2    wrong usage or an invalid file
  3    no plan found; the constraints that conflict are named
  4    a plan was found, but it is not proven, or replayed members violate it
  5    limit reached; the best plan so far is saved
  130  interrupted (143: terminated); the best plan so far is saved"""

app = typer.Typer(
    name=NAME,
    help="Plan one broadcast control for a whole fleet of unequal robots.\n\n"
    "'ensemble-plan CONFIG' is the same as 'ensemble-plan run CONFIG'.",
    epilog="Start with: ensemble-plan examples",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)

Json = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")]
Config = Annotated[str, typer.Argument(help="Problem file (YAML); - reads stdin.", metavar="CONFIG")]
Output = Annotated[
    Path | None,
    typer.Option("-o", "--output", help="Results folder [default: plans/<name>].", metavar="DIR"),
]
Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", help="Change a field: a dotted key and a YAML value; repeatable.", metavar="KEY=VALUE"),
]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="No progress, no warnings.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace earlier results in DIR.")]
Members = Annotated[int | None, typer.Option(help="Members to replay (verify.members).", metavar="N", min=1)]


class UsageError(EnsembleError):
    """The command was called wrongly."""


@app.callback(invoke_without_command=True)
def _main(
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.", is_eager=True)] = False,
) -> None:
    if version:
        say(f"{NAME} {__version__}")
        raise typer.Exit


@app.command(epilog=EXIT_CODES)
def run(
    context: typer.Context,
    config: Config,
    output: Output = None,
    overrides: Overrides = None,
    method: Annotated[str | None, typer.Option(help="Solution method (solve.method): nlp.", metavar="METHOD")] = None,
    time_limit: Annotated[
        str | None,
        typer.Option(help="Stop after this long with the best plan so far (solve.time_limit).", metavar="60s"),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(help="Seed of the replayed members (solve.seed).", metavar="N", min=0)
    ] = None,
    members: Members = None,
    guess: Annotated[
        Path | None,
        typer.Option(help="Start from a saved plan (plan.npz or its folder).", metavar="PLAN"),
    ] = None,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Annotated[
        bool, typer.Option("-v", "--verbose", help="A line for each iteration, and the routes tried.")
    ] = False,
    no_plots: Annotated[bool, typer.Option("--no-plots", help="Draw no figures.")] = False,
    overwrite: Overwrite = False,
) -> None:
    """Plan for CONFIG, replay the plan, and write the results folder."""
    if quiet and verbose:
        raise UsageError("expected one of -q and -v, got both")
    from ensemble_ctrl.cli.run import RunOptions
    from ensemble_ctrl.cli.run import run as run_plan

    given = {
        "solve.method": method,
        "solve.time_limit": time_limit,
        "solve.seed": seed,
        "verify.members": members,
    }
    changes = [*(overrides or ()), *(f"{key}={value}" for key, value in given.items() if value is not None)]
    options = RunOptions(
        config=config,
        output=output,
        overrides=tuple(changes),
        guess=guess,
        json=json,
        quiet=quiet,
        verbose=verbose,
        plots=not no_plots,
        overwrite=overwrite,
        command=(NAME, *context.obj),
    )
    raise typer.Exit(run_plan(options))


@app.command()
def check(
    configs: Annotated[list[str], typer.Argument(help="Problem files; - reads stdin.", metavar="CONFIG")],
    json: Json = False,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="Say only what is wrong.")] = False,
) -> None:
    """Check problem files without solving."""
    from ensemble_ctrl.cli.check import check_files

    raise typer.Exit(check_files(configs, json, quiet))


@app.command()
def show(
    plan: Annotated[Path, typer.Argument(help="A results folder or its plan.npz.", metavar="PLAN")],
    members: Members = None,
    substeps: Annotated[
        int | None, typer.Option(help="Times looked at in each step (verify.substeps).", metavar="N", min=1)
    ] = None,
    json: Json = False,
) -> None:
    """Replay a saved plan and print its summary again."""
    from ensemble_ctrl.cli.show import show_plan

    raise typer.Exit(show_plan(plan, members, substeps, json))


@app.command()
def verify(
    plan: Annotated[
        Path, typer.Argument(help="A results folder, its plan.npz, or a folder with controls.csv.", metavar="PLAN")
    ],
    parameter_range: Annotated[
        list[str] | None, typer.Option("--range", help="Ask about another range.", metavar="NAME=LOW:HIGH")
    ] = None,
    members: Members = None,
    json: Json = False,
) -> None:
    """Prove a saved plan again from its files alone."""
    from ensemble_ctrl.cli.verify import verify_plan

    raise typer.Exit(verify_plan(plan, parameter_range or [], members, json))


@app.command()
def compare(
    config: Config,
    output: Output = None,
    overrides: Overrides = None,
    json: Json = False,
    quiet: Quiet = False,
    no_plots: Annotated[bool, typer.Option("--no-plots", help="Draw no figure.")] = False,
    overwrite: Overwrite = False,
) -> None:
    """Plan with each guarantee and compare the plans."""
    from ensemble_ctrl.cli.compare import compare_guarantees

    raise typer.Exit(compare_guarantees(config, output, overrides or [], json, quiet, not no_plots, overwrite))


@app.command()
def widest(
    config: Config,
    overrides: Overrides = None,
    tolerance: Annotated[float, typer.Option(help="Find the half width to within this.", metavar="X", min=1e-4)] = 0.01,
    parameter: Annotated[
        str | None, typer.Option(help="The parameter to widen; the fleet's first otherwise.", metavar="NAME")
    ] = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Find the widest parameter range with a certified plan."""
    from ensemble_ctrl.cli.widest import find_widest

    raise typer.Exit(find_widest(config, overrides or [], tolerance, parameter, json, quiet))


@app.command()
def online(
    config: Config,
    output: Output = None,
    overrides: Overrides = None,
    traction: Annotated[
        float | None, typer.Option(help="The robot's true traction (online.robot.traction).", metavar="X", min=1e-3)
    ] = None,
    seed: Annotated[
        int | None, typer.Option(help="Seed of the robot's noise (online.robot.seed).", metavar="N", min=0)
    ] = None,
    json: Json = False,
    quiet: Quiet = False,
    no_plots: Annotated[bool, typer.Option("--no-plots", help="Draw no figures.")] = False,
    overwrite: Overwrite = False,
) -> None:
    """Measure, learn, plan again, apply: run CONFIG on a simulated robot."""
    from ensemble_ctrl.cli.online import OnlineRun, run_online

    given = OnlineRun(config, output, tuple(overrides or ()), traction, seed, json, quiet, not no_plots, overwrite)
    raise typer.Exit(run_online(given))


@app.command()
def models() -> None:
    """List the models, their controls and parameters."""
    from ensemble_ctrl.systems import SYSTEMS

    for name, system in SYSTEMS.items():
        controls = ", ".join(f"{n} [{u}]" for n, u in zip(system.controls, system.control_units, strict=True))
        say(f"{name:<12}{system.summary}\n{'':<12}controls {controls}; parameters {', '.join(system.parameters)}")


@app.command()
def examples(
    name: Annotated[str | None, typer.Argument(help="The example to print.", metavar="NAME")] = None,
    copy: Annotated[bool, typer.Option("--copy", help="Write it here as NAME.yaml instead.")] = False,
) -> None:
    """List the example problems, print one, or copy one."""
    from ensemble_ctrl.cli.examples import list_or_print

    list_or_print(name, copy)


@app.command()
def doctor() -> None:
    """Say what is installed and solve a tiny problem."""
    from ensemble_ctrl.cli.doctor import examine

    raise typer.Exit(examine())


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit; a user's mistake is one clear message, never a traceback."""
    with suppress(AttributeError, ValueError):
        sys.stdout.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]
    sys.exit(invoke(list(sys.argv[1:] if arguments is None else arguments)))


def invoke(arguments: list[str]) -> int:
    """Run the command line; returns the exit code."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "1")  # looking for them reads every installed package's metadata
    as_json = "--json" in arguments
    try:
        command = typer.main.get_command(app)
        with command.make_context(NAME, with_command(arguments), obj=tuple(arguments)) as context:
            return int(command.invoke(context) or 0)
    except typer.Exit as end:
        return int(end.exit_code)
    except KeyboardInterrupt:
        return fail(codes.INTERRUPTED, "interrupted; there is no plan yet", as_json)
    except BrokenPipeError:  # while the help was printed
        silence()
        return codes.OK
    except EnsembleError as error:
        return fail_with(codes.USAGE, error, as_json)
    except OSError as error:
        return fail(codes.INTERNAL, f"{error.filename or 'output'}: {error.strerror or error}", as_json)
    except Exception as error:
        return _unexpected(error, as_json)


def with_command(arguments: list[str]) -> list[str]:
    """Put ``run`` before a problem file that stands where a command could; ``./check`` is a file.

    Raises
    ------
    UsageError
        If there is no such file, and the word is much like a command's name.
    """
    commands = [command.callback.__name__ for command in app.registered_commands if command.callback]
    first = arguments[0] if arguments else ""
    if not first or first in (*commands, "-h", "--help", "--version"):
        return arguments
    close = get_close_matches(first, commands, n=1, cutoff=0.65)
    if close and first.isalpha() and not os.path.exists(first):
        raise UsageError(f"{first}: there is no such command or file; did you mean {close[0]!r}?")
    return ["run", *arguments]


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
