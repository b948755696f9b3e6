"""Subcommands that make plans, and that show, draw or prove saved ones; each does its work elsewhere."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ensemble_ctrl.cli import completion
from ensemble_ctrl.cli.memory import require_memory
from ensemble_ctrl.cli.root import (
    EXIT_CODES,
    NAME,
    ComparedIn,
    Config,
    Files,
    Json,
    Members,
    NoBrowser,
    Output,
    Overrides,
    Overwrite,
    Quiet,
    Replace,
    Saved,
    Trust,
    UsageError,
    Watch,
    app,
    examples_of,
    require_watch,
)


@app.command(
    epilog=examples_of(
        "ensemble-plan problem.yaml",
        "ensemble-plan problem.yaml -o out --overwrite --time-limit 60s",
        "ensemble-plan problem.yaml --set horizon.duration=20s",
        "ensemble-plan problem.yaml --guess plans/problem --json > result.json",
        "ensemble-plan problem.yaml --watch",
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
        int,
        typer.Option(
            "-v", "--verbose", count=True, help="A line for each iteration, the routes tried and decisions; -vv: all."
        ),
    ] = 0,
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
    watch: Watch = False,
    no_browser: NoBrowser = False,
    trust: Trust = False,
) -> None:
    """Plan for CONFIG, replay the plan, and write the results folder."""
    if quiet and verbose:
        raise UsageError("expected one of -q and -v, got both")
    require_watch(watch, no_browser)
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
        watch=watch,
        browser=not no_browser,
    )
    raise typer.Exit(run_plan(options))


@app.command(
    epilog=examples_of(
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
    epilog=examples_of(
        "ensemble-plan show plans/problem",
        "ensemble-plan show plans/problem --members 100000 --substeps 10",
    )
)
def show(
    plan: Saved,
    members: Members = None,
    substeps: Annotated[
        int | None, typer.Option(help="Samples per step (verify.substeps).", metavar="N", min=1)
    ] = None,
    json: Json = False,
    trust: Trust = False,
) -> None:
    """Replay a saved plan and print its summary again."""
    from ensemble_ctrl.cli.show import show_plan

    raise typer.Exit(show_plan(plan, members, substeps, json))


@app.command(
    epilog=examples_of(
        "ensemble-plan replay plans/problem",
        "ensemble-plan replay plans/problem --members 1e8 -o replay.json",
        "ensemble-plan replay plans/problem --members 1e7 --substeps 4 --seed 3",
        "ensemble-plan replay plans/problem --cluster local --checkpoint run.jsonl",
    )
)
def replay(
    plan: Saved,
    members: Annotated[str, typer.Option(help="How many, such as 1000000 or 1e8.", metavar="N")] = "1e6",
    substeps: Annotated[
        int | None, typer.Option(help="Samples per step (verify.substeps).", metavar="N", min=1)
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of the draw (solve.seed).", metavar="N", min=0)] = None,
    block: Annotated[
        str, typer.Option(help="Members of a block: the draw, and the memory, depend on it.", metavar="N")
    ] = "1e5",
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Write the summary as JSON too.", metavar="FILE")
    ] = None,
    cluster: Annotated[
        str | None,
        typer.Option(
            help="local, local:N or tcp://HOST:PORT of a Dask scheduler [default: this process].", metavar="WHERE"
        ),
    ] = None,
    checkpoint: Annotated[
        Path | None,
        typer.Option(help="Keep finished blocks in FILE; a rerun goes on from there.", metavar="FILE"),
    ] = None,
    json: Json = False,
    quiet: Quiet = False,
    overwrite: Replace = False,
    trust: Trust = False,
) -> None:
    """Run a saved plan on any number of members, in bounded memory."""
    from ensemble_ctrl.cli.replaying import ReplayOptions, count, replay_plan

    wanted, size = count("--members", members), count("--block", block)
    given = ReplayOptions(
        plan, wanted, substeps, seed, size, output, json, quiet, overwrite, cluster, checkpoint
    )  # fmt: skip
    raise typer.Exit(replay_plan(given))


@app.command(
    epilog=examples_of(
        "ensemble-plan report plans/problem",
        "ensemble-plan report plans/problem -o problem.html",
        "ensemble-plan report plans/problem --tolerance",
    )
)
def report(
    plan: Saved,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="The file [default: report.html beside it].", metavar="FILE")
    ] = None,
    tolerance: Annotated[
        bool, typer.Option("--tolerance", help="Measure how much error of the model it tolerates, too, and show bars.")
    ] = False,
    attack: Annotated[
        bool, typer.Option("--attack", help="With --tolerance: look for disturbances that break it; takes minutes.")
    ] = False,
    overwrite: Replace = False,
    trust: Trust = False,
) -> None:
    """Write a saved plan's report.html again."""
    from ensemble_ctrl.cli.report import report_plan

    report_plan(plan, output, overwrite, tolerance, attack)


@app.command(
    epilog=examples_of(
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
            "spread, certificate.",
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
    epilog=examples_of(
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
    epilog=examples_of(
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
    each: Annotated[bool, typer.Option("--each", help="Refine the clearance from every obstacle.")] = False,
    json: Json = False,
    trust: Trust = False,
) -> None:
    """Prove a saved plan again from its files alone."""
    from ensemble_ctrl.cli.verify import verify_plan

    raise typer.Exit(verify_plan(plan, parameter_range or [], members, json, ignore_bounds, each))


@app.command(
    epilog=examples_of(
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
