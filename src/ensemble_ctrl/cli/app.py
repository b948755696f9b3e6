"""The command line: subcommands and options; each does its work elsewhere."""

from __future__ import annotations

import os
import signal
import sys
from contextlib import suppress
from contextvars import copy_context
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated

import typer

from ensemble_ctrl.cli import codes, completion
from ensemble_ctrl.cli.memory import MemoryLimitError, require_memory
from ensemble_ctrl.cli.streams import OutputError, complain, fail, fail_with, keep_standard_streams, say, silence
from ensemble_ctrl.cli.watcher import forget_after_one
from ensemble_ctrl.core.errors import EnsembleError, WorkerError
from ensemble_ctrl.core.version import __version__

NAME = "ensemble-plan"
COMPLETING = "_ENSEMBLE_PLAN_COMPLETE"
"""Set by a shell's completion script."""
EXIT_CODES = """\b
Exit codes:
  0    planned, proven for every member, and no replayed member violates
  1    internal error, or the results could not be written
  2    wrong usage or an invalid file
  3    no plan found; the constraints that conflict are named
  4    a plan was found, but it is not proven, or replayed members violate it
  5    limit reached; the best plan so far is saved
  130  interrupted (143: terminated); the best plan so far is saved"""


def _examples(*lines: str, more: str = "") -> str:
    """The end of a command's help: what one would type."""
    return "\n".join(["\b", "Examples:", *(f"  {line}" for line in lines)]) + (f"\n\n{more}" if more else "")


app = typer.Typer(
    name=NAME,
    help="Plan one broadcast control for a whole fleet of heterogeneous robots.\n\n"
    "'ensemble-plan CONFIG' is the same as 'ensemble-plan run CONFIG'.",
    epilog=_examples(
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

Json = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")]
Config = Annotated[str, typer.Argument(help="Problem file (YAML); - reads stdin.", metavar="CONFIG")]
Output = Annotated[
    Path | None,
    typer.Option("-o", "--output", help="Results folder [default: plans/<name>].", metavar="DIR"),
]
ComparedIn = Annotated[
    Path | None,
    typer.Option("-o", "--output", help="Results folder [default: plans/<name>-compare].", metavar="DIR"),
]
LoggedIn = Annotated[
    Path | None,
    typer.Option("-o", "--output", help="Results folder [default: plans/<name>-online].", metavar="DIR"),
]
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


def _consent(given: bool) -> bool:
    """Let the Python file of a user's own system run, for this call of the command."""
    if given:
        from ensemble_ctrl.files.config.own import CONSENT

        CONSENT.set(True)
    return given


Trust = Annotated[bool, typer.Option("--trust", help="Run the Python file that fleet.model names.", callback=_consent)]
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


@app.command(
    epilog=_examples(
        "ensemble-plan problem.yaml",
        "ensemble-plan problem.yaml -o out --overwrite --time-limit 60s",
        "ensemble-plan problem.yaml --set horizon.duration=20s",
        "ensemble-plan problem.yaml --guess plans/problem --json > result.json",
        more=EXIT_CODES,
    )
)
def run(
    context: typer.Context,
    config: Config,
    output: Output = None,
    overrides: Overrides = None,
    method: Annotated[
        str | None,
        typer.Option(
            help="Solution method (solve.method): nlp or minlp.", metavar="METHOD", autocompletion=completion.methods
        ),
    ] = None,
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
    no_plots: Annotated[bool, typer.Option("--no-plots", help="Draw no figures and write no report.")] = False,
    animation: Annotated[
        str | None,
        typer.Option(
            "--animate",
            help="Write an animation too: gif or mp4.",
            metavar="FORMAT",
            autocompletion=completion.film_formats,
        ),
    ] = None,
    no_suggest: Annotated[
        bool, typer.Option("--no-suggest", help="Where there is no plan, do not look for what would help.")
    ] = False,
    overwrite: Overwrite = False,
    trust: Trust = False,
) -> None:
    """Plan for CONFIG, replay the plan, and write the results folder."""
    if quiet and verbose:
        raise UsageError("expected one of -q and -v, got both")
    require_memory()
    from ensemble_ctrl.cli.run import RunOptions
    from ensemble_ctrl.cli.run import run as run_plan

    given = {
        "--method": ("solve.method", method),
        "--time-limit": ("solve.time_limit", time_limit),
        "--seed": ("solve.seed", seed),
        "--members": ("verify.members", members),
    }
    typed = [(option, f"{key}={value}") for option, (key, value) in given.items() if value is not None]
    options = RunOptions(
        config=config,
        output=output,
        overrides=(*(overrides or ()), *typed),
        guess=guess,
        json=json,
        quiet=quiet,
        verbose=verbose,
        plots=not no_plots,
        animation=animation,
        suggest=not no_suggest,
        overwrite=overwrite,
        command=(NAME, *context.obj),
    )
    raise typer.Exit(run_plan(options))


@app.command(
    epilog=_examples(
        "ensemble-plan check problem.yaml",
        "ensemble-plan check configs/*.yaml -q",
        "ensemble-plan check problem.yaml --set horizon.duration=20s",
        "ensemble-plan check - < problem.yaml",
    )
)
def check(
    configs: Annotated[list[str], typer.Argument(help="Problem files; - reads stdin.", metavar="CONFIG")],
    overrides: Overrides = None,
    json: Json = False,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="Say only what is wrong.")] = False,
    trust: Trust = False,
) -> None:
    """Check problem files without solving."""
    from ensemble_ctrl.cli.check import check_files

    raise typer.Exit(check_files(configs, json, quiet, overrides or []))


@app.command(
    epilog=_examples(
        "ensemble-plan show plans/problem",
        "ensemble-plan show plans/problem --members 100000 --substeps 10",
    )
)
def show(
    plan: Saved,
    members: Members = None,
    substeps: Annotated[
        int | None, typer.Option(help="Times looked at in each step (verify.substeps).", metavar="N", min=1)
    ] = None,
    json: Json = False,
    trust: Trust = False,
) -> None:
    """Replay a saved plan and print its summary again."""
    from ensemble_ctrl.cli.show import show_plan

    raise typer.Exit(show_plan(plan, members, substeps, json))


@app.command(
    epilog=_examples(
        "ensemble-plan report plans/problem",
        "ensemble-plan report plans/problem -o problem.html",
    )
)
def report(
    plan: Saved,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="The file [default: report.html beside it].", metavar="FILE")
    ] = None,
    overwrite: Replace = False,
    trust: Trust = False,
) -> None:
    """Write a saved plan's report.html again."""
    from ensemble_ctrl.cli.report import report_plan

    report_plan(plan, output, overwrite)


@app.command(
    epilog=_examples(
        "ensemble-plan plot plans/problem",
        "ensemble-plan plot plans/problem trajectories -o fleet.pdf",
        "ensemble-plan plot plans/problem controls moments --format svg",
    )
)
def plot(
    plan: Saved,
    kinds: Annotated[
        list[str] | None,
        typer.Argument(
            help="Kinds of pictures [default: all]: trajectories, controls, moments, robustness, clearance, "
            "certificate.",
            metavar="KIND",
            show_default=False,
            autocompletion=completion.kinds,
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", help="The file; of several kinds the folder [default: beside the plan].", metavar="FILE"
        ),
    ] = None,
    format: Annotated[
        str | None,
        typer.Option(
            "--format",
            help="png, pdf or svg [default: as FILE ends, or png].",
            metavar="FORMAT",
            autocompletion=completion.picture_formats,
        ),
    ] = None,
    overwrite: Replace = False,
    trust: Trust = False,
) -> None:
    """Draw a saved plan for a paper, a column wide."""
    from ensemble_ctrl.cli.plot import plot_plan

    plot_plan(plan, kinds or [], output, format, overwrite)


@app.command(
    epilog=_examples(
        "ensemble-plan animate plans/problem",
        "ensemble-plan animate plans/problem -o fleet.mp4 --seconds 10",
    )
)
def animate(
    plan: Saved,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="A .gif or .mp4 [default: animation.gif beside it].", metavar="FILE"),
    ] = None,
    seconds: Annotated[float, typer.Option(help="How long it runs.", metavar="N")] = 6.0,
    overwrite: Replace = False,
    trust: Trust = False,
) -> None:
    """Show a saved plan's fleet on its way."""
    from ensemble_ctrl.cli.animate import animate_plan

    animate_plan(plan, output, seconds, overwrite)


@app.command(
    epilog=_examples(
        "ensemble-plan verify plans/problem",
        "ensemble-plan verify plans/problem --range traction=0.85:1.15",
    )
)
def verify(
    plan: Files,
    parameter_range: Annotated[
        list[str] | None, typer.Option("--range", help="Ask about another range.", metavar="NAME=LOW:HIGH")
    ] = None,
    members: Members = None,
    ignore_bounds: Annotated[
        bool, typer.Option("--ignore-bounds", help="Accept commands beyond the input or rate bounds.")
    ] = False,
    json: Json = False,
    trust: Trust = False,
) -> None:
    """Prove a saved plan again from its files alone."""
    from ensemble_ctrl.cli.verify import verify_plan

    raise typer.Exit(verify_plan(plan, parameter_range or [], members, json, ignore_bounds))


@app.command(
    epilog=_examples(
        "ensemble-plan compare problem.yaml",
        "ensemble-plan compare problem.yaml -o compared --no-plots",
    )
)
def compare(
    config: Config,
    output: ComparedIn = None,
    overrides: Overrides = None,
    json: Json = False,
    quiet: Quiet = False,
    no_plots: Annotated[bool, typer.Option("--no-plots", help="Draw no figure.")] = False,
    overwrite: Overwrite = False,
    trust: Trust = False,
) -> None:
    """Plan with each guarantee and compare the plans."""
    require_memory()
    from ensemble_ctrl.cli.compare import compare_guarantees

    raise typer.Exit(compare_guarantees(config, output, overrides or [], json, quiet, not no_plots, overwrite))


@app.command(
    epilog=_examples(
        "ensemble-plan widest problem.yaml",
        "ensemble-plan widest problem.yaml --parameter traction --tolerance 0.001",
    )
)
def widest(
    config: Config,
    overrides: Overrides = None,
    tolerance: Annotated[float, typer.Option(help="Find the half width to within this.", metavar="X", min=1e-4)] = 0.01,
    parameter: Annotated[
        str | None, typer.Option(help="The parameter to widen; the fleet's first otherwise.", metavar="NAME")
    ] = None,
    json: Json = False,
    quiet: Quiet = False,
    trust: Trust = False,
) -> None:
    """Find the widest parameter range with a certified plan."""
    require_memory()
    from ensemble_ctrl.cli.widest import find_widest

    raise typer.Exit(find_widest(config, overrides or [], tolerance, parameter, json, quiet))


@app.command(
    "import",
    epilog=_examples(
        "ensemble-plan import office.geojson              print a problem to complete",
        "ensemble-plan import map.yaml -o office.yaml     an occupancy grid of ROS",
        "ensemble-plan import yard.wkt --section >> problem.yaml",
    ),
)
def import_map(
    source: Annotated[
        Path, typer.Argument(help="GeoJSON, WKT, or the .yaml of an occupancy grid (ROS).", metavar="MAP")
    ],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Write this file instead of printing.", metavar="FILE")
    ] = None,
    tolerance: Annotated[
        str | None,
        typer.Option(
            help="How far obstacles may grow, so that they need fewer pieces [default: 2 cells of a grid, else 0].",
            metavar="LENGTH",
        ),
    ] = None,
    unknown: Annotated[
        str | None,
        typer.Option(
            help="What cells of a grid are that no scan has seen: occupied or free [default: occupied].",
            metavar="WHAT",
            autocompletion=completion.unknown_cells,
        ),
    ] = None,
    section: Annotated[bool, typer.Option("--section", help="Only the obstacles and regions.")] = False,
    overwrite: Replace = False,
) -> None:
    """Turn a map into a problem file with few convex obstacles."""
    from ensemble_ctrl.cli.importing import import_file

    import_file(source, output, tolerance, unknown, section, overwrite)


@app.command(
    epilog=_examples(
        "ensemble-plan export plans/office -o office.csv",
        "ensemble-plan export plans/office --to geojson > tube.geojson",
        "ensemble-plan export plans/office --to rosbag -o office_bag --members 9",
    )
)
def export(
    plan: Files,
    form: Annotated[
        str | None,
        typer.Option(
            "--to",
            help="csv, json, geojson or rosbag [default: the ending of FILE].",
            metavar="FORMAT",
            autocompletion=completion.export_formats,
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Write this file (rosbag: folder) instead of printing.", metavar="FILE"),
    ] = None,
    members: Annotated[
        int | None,
        typer.Option(help="Members whose paths are written [default: csv 0, json 5, rosbag 5].", metavar="N", min=0),
    ] = None,
    overwrite: Replace = False,
    trust: Trust = False,
) -> None:
    """Write a saved plan for other programs."""
    from ensemble_ctrl.cli.exporting import export_plan

    export_plan(plan, form, output, members, overwrite)


@app.command(
    epilog=_examples(
        "ensemble-plan online problem.yaml",
        "ensemble-plan online problem.yaml --traction 0.93 --seed 7",
        "ensemble-plan online problem.yaml --set online.deadline=0.1s --json",
    )
)
def online(
    config: Config,
    output: LoggedIn = None,
    overrides: Overrides = None,
    traction: Annotated[
        float | None,
        typer.Option(help="The true traction of the robots (online.robot.traction).", metavar="X", min=1e-3),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(help="Seed of the robots' noise (online.robot.seed).", metavar="N", min=0)
    ] = None,
    json: Json = False,
    quiet: Quiet = False,
    no_plots: Annotated[bool, typer.Option("--no-plots", help="Draw no figures.")] = False,
    overwrite: Overwrite = False,
    trust: Trust = False,
) -> None:
    """Measure, learn, plan again, apply, on a simulated robot."""
    require_memory()
    from ensemble_ctrl.cli.online import OnlineRun, run_online

    given = OnlineRun(config, output, tuple(overrides or ()), traction, seed, json, quiet, not no_plots, overwrite)
    raise typer.Exit(run_online(given))


@app.command()
def models() -> None:
    """List the models, their controls and parameters."""
    from ensemble_ctrl.systems import SYSTEMS

    for name, system in SYSTEMS.items():
        controls = ", ".join(f"{n} [{u}]" for n, u in zip(system.controls, system.control_units, strict=True))
        say(f"{name:<18}{system.summary}\n{'':<18}controls {controls}; parameters {', '.join(system.parameters)}")
        say(f"{'':<18}states {', '.join(system.states)}")
    say("your own: fleet: {model: {python: my_system.py:MySystem}}, with --trust")


@app.command(
    epilog=_examples(
        "ensemble-plan examples",
        "ensemble-plan examples five_obstacles",
        "ensemble-plan examples five_obstacles --copy",
    )
)
def examples(
    name: Annotated[
        str | None,
        typer.Argument(help="The example to print.", metavar="NAME", autocompletion=completion.examples),
    ] = None,
    copy: Annotated[bool, typer.Option("--copy", help="Write it here as NAME.yaml instead.")] = False,
) -> None:
    """List the example problems, print one, or copy one."""
    from ensemble_ctrl.cli.examples import list_or_print

    list_or_print(name, copy)


@app.command(
    epilog=_examples(
        "ensemble-plan init",
        "ensemble-plan init fleet.yaml --schema",
        "ensemble-plan init - | ensemble-plan check -",
    )
)
def init(
    file: Annotated[
        Path, typer.Argument(help="The new file; - prints it instead.", metavar="FILE", show_default="problem.yaml")
    ] = Path("problem.yaml"),
    schema: Annotated[bool, typer.Option("--schema", help="Write the JSON Schema beside it too, for editors.")] = False,
) -> None:
    """Write a commented problem file to start from."""
    from ensemble_ctrl.cli.init import start

    start(file, schema)


@app.command(
    epilog=_examples(
        "ensemble-plan schema > problem.schema.json",
        "ensemble-plan schema -o problem.schema.json",
    )
)
def schema(
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Write it to this file instead.", metavar="FILE")
    ] = None,
) -> None:
    """Print the JSON Schema of problem files, for editors."""
    from ensemble_ctrl.cli.init import print_schema

    print_schema(output)


@app.command()
def doctor() -> None:
    """Say what is installed and solve a tiny problem."""
    from ensemble_ctrl.cli.doctor import examine

    raise typer.Exit(examine())


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
    return [command.name or command.callback.__name__ for command in app.registered_commands if command.callback]


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
