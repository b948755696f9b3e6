"""The command line: subcommands and options; each does its work elsewhere."""

from __future__ import annotations

import os
import sys

from pathlib import Path
from typing import Annotated, Any

import typer

from ensemble_ctrl._version import __version__
from ensemble_ctrl.cli import codes
from ensemble_ctrl.errors import EnsembleError

app = typer.Typer(
    name="ensemble-plan",
    help="Plan one broadcast control for a whole fleet of unequal robots. "
    "`ensemble-plan CONFIG` is the same as `ensemble-plan run CONFIG`.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

Config = Annotated[str, typer.Argument(help="Problem file (YAML); - reads stdin.", metavar="CONFIG")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")]


@app.callback(invoke_without_command=True)
def _main(
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.", is_eager=True)] = False,
) -> None:
    if version:
        print(f"ensemble-plan {__version__}")
        raise typer.Exit


@app.command()
def run(
    config: Config,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Results folder [default: plans/<name>].", metavar="DIR")
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", help="Change a field: a dotted key and a YAML value; repeatable.", metavar="KEY=VALUE"),
    ] = None,
    method: Annotated[str | None, typer.Option(help="Solution method (solve.method): nlp.", metavar="METHOD")] = None,
    time_limit: Annotated[
        str | None, typer.Option(help="Stop after this long with the best plan so far (solve.time_limit).", metavar="60s")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of the replayed members (solve.seed).", metavar="N")] = None,
    members: Annotated[int | None, typer.Option(help="Members to replay (verify.members).", metavar="N")] = None,
    guess: Annotated[
        Path | None, typer.Option(help="Start from a saved plan (plan.npz or its folder).", metavar="PLAN")
    ] = None,
    json: Json = False,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="No progress, no warnings.")] = False,
    verbose: Annotated[bool, typer.Option("-v", "--verbose", help="A line for each iteration.")] = False,
    no_plots: Annotated[bool, typer.Option("--no-plots", help="Draw no figures.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a folder of earlier results.")] = False,
) -> None:
    """Plan for CONFIG, replay the plan, and write the results folder."""
    from ensemble_ctrl.cli.run import RunOptions
    from ensemble_ctrl.cli.run import run as run_plan

    given = {"solve.method": method, "solve.time_limit": time_limit, "solve.seed": seed, "verify.members": members}
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
        command=("ensemble-plan", *sys.argv[1:]),
    )
    raise typer.Exit(run_plan(options))


@app.command()
def check(
    configs: Annotated[list[str], typer.Argument(help="Problem files.", metavar="CONFIG...")],
    json: Json = False,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="Say nothing about good files.")] = False,
) -> None:
    """Check problem files without solving; errors have file, line and column."""
    from ensemble_ctrl.cli.check import check_files

    raise typer.Exit(check_files(configs, json, quiet))


@app.command()
def show(
    plan: Annotated[Path, typer.Argument(help="A results folder or its plan.npz.", metavar="PLAN")],
    members: Annotated[int | None, typer.Option(help="Members to replay.", metavar="N")] = None,
    substeps: Annotated[int | None, typer.Option(help="Times looked at in each step.", metavar="N")] = None,
    json: Json = False,
) -> None:
    """Replay a saved plan and print its summary again."""
    from ensemble_ctrl.api import Plan, with_replay
    from ensemble_ctrl.cli.run import exit_code
    from ensemble_ctrl.report import summary_lines
    from ensemble_ctrl.results import summary, to_json

    saved = Plan.load(plan)
    found = with_replay(saved, saved.replay(members, substeps=substeps))
    print(to_json(summary(found)) if json else "\n".join(summary_lines(found, str(plan))))
    raise typer.Exit(exit_code(found))


@app.command()
def models() -> None:
    """List the models a fleet can have, with their controls and parameters."""
    from ensemble_ctrl.systems import SYSTEMS

    for name, system in SYSTEMS.items():
        controls = ", ".join(f"{n} [{u}]" for n, u in zip(system.controls, system.control_units, strict=True))
        print(f"{name:<12}{system.summary}\n{'':<12}controls {controls}; parameters {', '.join(system.parameters)}")


@app.command()
def examples(
    name: Annotated[str | None, typer.Argument(help="The example to print.", metavar="[NAME]")] = None,
    copy: Annotated[bool, typer.Option("--copy", help="Write it here as NAME.yaml instead.")] = False,
) -> None:
    """List the example problems, print one, or copy one here."""
    from ensemble_ctrl.cli.examples import list_or_print

    raise typer.Exit(list_or_print(name, copy))


@app.command()
def doctor() -> None:
    """Say what is installed and solve a tiny problem, to see that all works here."""
    from ensemble_ctrl.cli.doctor import examine

    raise typer.Exit(examine())


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit; a user's mistake is one clear message, never a traceback."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    sys.exit(invoke(arguments))


def invoke(arguments: list[str]) -> int:
    """Run the command line; returns the exit code."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    try:
        result: Any = app(with_command(arguments), prog_name="ensemble-plan", standalone_mode=False)
        return int(result or 0)
    except typer.Exit as end:
        return int(end.exit_code)
    except (typer.Abort, KeyboardInterrupt):
        return codes.INTERRUPTED
    except BrokenPipeError:
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115  (Python flushes stdout once more at exit)
        return codes.OK
    except EnsembleError as error:
        return _failed(arguments, codes.USAGE, str(error))
    except Exception as error:
        if hasattr(error, "format_message"):  # click's own usage errors
            error.show()  # type: ignore[attr-defined]
            return codes.USAGE
        if os.environ.get("ENSEMBLE_PLAN_DEBUG"):
            raise
        text = f"internal error: {type(error).__name__}: {error} (set ENSEMBLE_PLAN_DEBUG=1 for the traceback)"
        return _failed(arguments, codes.INTERNAL, text)


def with_command(arguments: list[str]) -> list[str]:
    """Put ``run`` before a problem file that stands where a command could; ``./check`` is a file."""
    commands = {command.name or command.callback.__name__ for command in app.registered_commands if command.callback}
    if not arguments or arguments[0] in commands or arguments[0] in ("--help", "--version"):
        return arguments
    return ["run", *arguments]


def _failed(arguments: list[str], code: int, message: str) -> int:
    """Say what was wrong: on stderr, and with ``--json`` as the one JSON object on stdout."""
    from ensemble_ctrl.results import SCHEMA, to_json

    if "--json" in arguments:
        print(to_json({"schema": SCHEMA, "status": "error", "exit_code": code, "message": message}))
    is_diagnostic = ": error: " in message
    print(message if is_diagnostic else f"error: {message}", file=sys.stderr)
    return code


