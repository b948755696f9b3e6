"""The command itself: its name, its help, and the options that several subcommands share."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from ensemble_ctrl.cli import completion
from ensemble_ctrl.cli.streams import say
from ensemble_ctrl.core.errors import EnsembleError, ProblemError
from ensemble_ctrl.core.version import __version__

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


def examples_of(*lines: str, more: str = "") -> str:
    """The end of a command's help: what one would type."""
    return "\n".join(["\b", "Examples:", *(f"  {line}" for line in lines)]) + (f"\n\n{more}" if more else "")


app = typer.Typer(
    name=NAME,
    help="Plan one broadcast control for a whole fleet of heterogeneous robots.\n\n"
    "'ensemble-plan CONFIG' is the same as 'ensemble-plan run CONFIG'.",
    epilog=examples_of(
        "ensemble-plan init                   write problem.yaml, to start from",
        "ensemble-plan check problem.yaml     say what is wrong with it",
        "ensemble-plan problem.yaml           plan, prove, write plans/problem/",
        "ensemble-plan verify plans/problem   prove the saved plan again",
        more="'ensemble-plan COMMAND --help' says more, with examples.",
    ),
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _folder(text: str) -> Any:
    """The option that names a folder for what is written."""
    return typer.Option("-o", "--output", help=text, metavar="DIR")


Json = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")]
Config = Annotated[str, typer.Argument(help="Problem file (YAML); - reads stdin.", metavar="CONFIG")]
Output = Annotated[Path | None, _folder("Results folder [default: plans/<name>].")]
ComparedIn = Annotated[Path | None, _folder("Results folder [default: plans/<name>-compare].")]
LoggedIn = Annotated[Path | None, _folder("Results folder [default: plans/<name>-online].")]
GroupedIn = Annotated[Path | None, _folder("Folder for the plans [default: plans/<name>-channels].")]
SweptIn = Annotated[Path | None, _folder("Results folder [default: plans/<name>-sweep].")]
ReproducedIn = Annotated[Path | None, _folder("Results folder [default: plans/paper].")]
WidestIn = Annotated[Path | None, _folder("Write the plan of the widest range here, as run does.")]
NoPlots = Annotated[bool, typer.Option("--no-plots", help="Draw no figures.")]
Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        help="Change a field: a dotted key and a YAML value; repeatable.",
        metavar="KEY=VALUE",
        autocompletion=completion.keys,
    ),
]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="No progress, no warnings.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace earlier results in DIR.")]
Replace = Annotated[bool, typer.Option("--overwrite", help="Replace FILE.")]
Files = Annotated[
    Path, typer.Argument(help="A results folder, its plan.npz, or a folder with controls.csv.", metavar="PLAN")
]
Saved = Annotated[Path, typer.Argument(help="A results folder or its plan.npz.", metavar="PLAN")]

NoBrowser = Annotated[bool, typer.Option("--no-browser", help="Open no browser; print the address.")]
Port = Annotated[int, typer.Option(help="Port on 127.0.0.1 [default: a free one].", metavar="N", min=0, max=65535)]
Watch = Annotated[bool, typer.Option("--watch", help="Show it live on a page in the browser.")]
UntilClosed = Annotated[
    bool, typer.Option("--until-closed", help="End when the last page is closed, not only with Ctrl-C.")
]

Cluster = Annotated[
    str,
    typer.Option(help="local, local:N for N processes, or tcp://HOST:PORT of a Dask scheduler.", metavar="WHERE"),
]


def require_watch(watch: bool, no_browser: bool) -> None:
    """Refuse ``--no-browser`` without a page."""
    if no_browser and not watch:
        raise UsageError("--no-browser: expected --watch with it")


def _consent(given: bool) -> bool:
    """Let the Python file of a user's own system run, for this call of the command."""
    if given:
        from ensemble_ctrl.files.config.user_system import CONSENT

        CONSENT.set(True)
    return given


Trust = Annotated[bool, typer.Option("--trust", help="Run the Python file that fleet.model names.", callback=_consent)]
Members = Annotated[int | None, typer.Option(help="Members to replay (verify.members).", metavar="N", min=1)]


class UsageError(EnsembleError):
    """The command was called wrongly."""


@contextmanager
def naming(**options: str) -> Iterator[None]:
    """Within: an error about an argument of a function names the option that it came from."""
    try:
        yield
    except ProblemError as error:
        argument, _, rest = str(error).partition(": ")
        if argument not in options:
            raise
        raise UsageError(f"{options[argument]}: {rest}") from error


@app.callback(invoke_without_command=True)
def _main(
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.", is_eager=True)] = False,
) -> None:
    if version:
        say(f"{NAME} {__version__}")
        raise typer.Exit
