"""Subcommands around plans: maps, other programs, the online loop, examples and help with problem files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ensemble_ctrl.cli import completion
from ensemble_ctrl.cli.memory import require_memory
from ensemble_ctrl.cli.root import (
    Cluster,
    Config,
    Files,
    Json,
    LoggedIn,
    NoBrowser,
    NoPlots,
    Overrides,
    Overwrite,
    Port,
    Quiet,
    Replace,
    ReproducedIn,
    Saved,
    SweptIn,
    Trust,
    UntilClosed,
    Watch,
    app,
    examples_of,
    require_watch,
)
from ensemble_ctrl.cli.streams import say


@app.command(
    epilog=examples_of(
        "ensemble-plan tolerance plans/five_obstacles",
        "ensemble-plan tolerance plans/five_obstacles --attack --chart tolerance.png",
    ),
)
def tolerance(
    plan: Saved,
    attack: Annotated[
        bool, typer.Option("--attack", help="Look for disturbances that break the plan, too: takes minutes.")
    ] = False,
    chart: Annotated[Path | None, typer.Option(help="Draw bars into FILE (png, svg, pdf).", metavar="FILE")] = None,
    json: Json = False,
    quiet: Quiet = False,
    overwrite: Replace = False,
    trust: Trust = False,
) -> None:
    """Measure how much error of the model a plan tolerates."""
    from ensemble_ctrl.cli.tolerance import measure_plan

    raise typer.Exit(measure_plan(plan, attack, chart, json, quiet, overwrite))


@app.command(
    epilog=examples_of(
        "ensemble-plan identify runs.csv",
        "ensemble-plan identify runs.csv --model bicycle --wheelbase 0.35",
        "ensemble-plan identify - < runs.csv",
    ),
)
def identify(
    log: Annotated[
        Path, typer.Argument(help="A CSV file: t, commands, x, y, heading, robot; - reads stdin.", metavar="LOG")
    ],
    model: Annotated[str, typer.Option(help="unicycle or bicycle.", metavar="MODEL")] = "unicycle",
    wheelbase: Annotated[float | None, typer.Option(help="Of a bicycle, metres.", metavar="LENGTH")] = None,
    json: Json = False,
) -> None:
    """Find ranges and bounds of errors from logs of robots."""
    from ensemble_ctrl.cli.identify import identify_log

    raise typer.Exit(identify_log(log, model, wheelbase, json))


@app.command(
    "import",
    epilog=examples_of(
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
    epilog=examples_of(
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
    epilog=examples_of(
        "ensemble-plan online problem.yaml",
        "ensemble-plan online problem.yaml --traction 0.93 --seed 7",
        "ensemble-plan online problem.yaml --set online.deadline=0.1s --json",
        "ensemble-plan online problem.yaml --watch",
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
    no_plots: NoPlots = False,
    overwrite: Overwrite = False,
    watch: Watch = False,
    no_browser: NoBrowser = False,
    trust: Trust = False,
) -> None:
    """Measure, learn, plan again, apply, on a simulated robot."""
    require_watch(watch, no_browser)
    require_memory()
    from ensemble_ctrl.cli.online import OnlineRun, run_online

    given = OnlineRun(
        config, output, tuple(overrides or ()), traction, seed, json, quiet, not no_plots, overwrite, watch,
        not no_browser,
    )  # fmt: skip
    raise typer.Exit(run_online(given))


@app.command(
    epilog=examples_of(
        "ensemble-plan sweep problem.yaml",
        "ensemble-plan sweep problem.yaml --axis 'solve.seed={seeds: 20}'",
        "ensemble-plan sweep configs/*.yaml --cluster local:4 -o all",
        "ensemble-plan sweep problem.yaml --cluster tcp://10.0.0.7:8786",
        more="Run it again after an end of any kind: rows that are there are kept.",
    )
)
def sweep(
    configs: Annotated[
        list[str], typer.Argument(help="Problem files, with axes in their section `sweep`.", metavar="CONFIG")
    ],
    output: SweptIn = None,
    overrides: Overrides = None,
    axes: Annotated[
        list[str] | None,
        typer.Option("--axis", help="A further axis: a dotted key and a list, range, seeds or files.", metavar="AXIS"),
    ] = None,
    cluster: Cluster = "local",
    format: Annotated[str, typer.Option("--format", help="csv or parquet.", metavar="FORMAT")] = "csv",
    value: Annotated[str, typer.Option("--plot", help="The column that is drawn.", metavar="COLUMN")] = "cost",
    json: Json = False,
    quiet: Quiet = False,
    no_plots: NoPlots = False,
    overwrite: Overwrite = False,
    trust: Trust = False,
) -> None:
    """Plan many problems: one row of facts for each."""
    require_memory()
    from ensemble_ctrl.cli.sweep import SweepRun, run_sweep

    given = SweepRun(
        tuple(configs), output, tuple(overrides or ()), tuple(axes or ()), cluster, format, value, json, quiet,
        not no_plots, overwrite,
    )  # fmt: skip
    raise typer.Exit(run_sweep(given))


@app.command(
    epilog=examples_of(
        "ensemble-plan paper                  all of it: half an hour on 2 cores",
        "ensemble-plan paper box five_obstacles --robot unicycle",
        "ensemble-plan paper box --members 1000 --json",
        "ensemble-plan paper --study --members 10000",
    )
)
def paper(
    experiments: Annotated[
        list[str] | None,
        typer.Argument(
            help="box, polyhedron, one_obstacles to eight_obstacles, two_waypoints [default: all].",
            metavar="EXPERIMENT",
            show_default=False,
        ),
    ] = None,
    robots: Annotated[
        list[str] | None,
        typer.Option("--robot", help="unicycle or bicycle [default: both].", metavar="ROBOT", show_default=False),
    ] = None,
    forms: Annotated[
        list[str] | None,
        typer.Option("--form", help="published, ours or linear [default: all].", metavar="FORM", show_default=False),
    ] = None,
    members: Annotated[int, typer.Option(help="Members replayed of each plan.", metavar="N", min=1)] = 100_000,
    bonmin_limit: Annotated[float, typer.Option(help="Seconds for each run of Bonmin.", metavar="N", min=0.1)] = 10.0,
    output: ReproducedIn = None,
    json: Json = False,
    quiet: Quiet = False,
    no_plots: NoPlots = False,
    overwrite: Overwrite = False,
    study: Annotated[bool, typer.Option("--study", help="Instead, study truncation orders 1 to 16.")] = False,
) -> None:
    """Plan the paper's experiments as published, and beside them."""
    require_memory()
    from ensemble_ctrl.api.paper import EXPERIMENTS, FORMS, ROBOTS
    from ensemble_ctrl.cli.paper import PaperRun, known, run_paper

    names = known("EXPERIMENT", experiments, EXPERIMENTS)
    kinds, shapes = known("--robot", robots, ROBOTS), known("--form", forms, FORMS)
    asked = PaperRun(names, kinds, shapes, members, bonmin_limit, output, json, quiet, not no_plots, overwrite, study)
    raise typer.Exit(run_paper(asked))


@app.command(
    epilog=examples_of(
        "ensemble-plan edit problem.yaml       draw, drag, prove in the browser",
        "ensemble-plan edit                    a new problem.yaml from nothing",
        "ensemble-plan edit office.yaml --no-browser --port 8765",
    )
)
def edit(
    file: Annotated[
        Path, typer.Argument(help="Problem file (YAML); a new one is written when you save.", metavar="FILE")
    ] = Path("problem.yaml"),
    port: Port = 0,
    no_browser: NoBrowser = False,
    until_closed: UntilClosed = False,
    trust: Trust = False,
) -> None:
    """Edit a problem in the browser, with its plan and proof."""
    require_memory()
    from ensemble_ctrl.cli.edit import edit_file

    raise typer.Exit(edit_file(file, port, not no_browser, until_closed, trust))


@app.command(
    epilog=examples_of(
        "ensemble-plan view plans/five_obstacles plans/wider",
        "ensemble-plan view plans/* --no-browser --port 8765",
    )
)
def view(
    plans: Annotated[
        list[Path], typer.Argument(help="Results folders or their plan.npz, six at most.", metavar="PLAN...")
    ],
    port: Port = 0,
    no_browser: NoBrowser = False,
    until_closed: UntilClosed = False,
    trust: Trust = False,
) -> None:
    """Show saved plans over each other in the browser."""
    from ensemble_ctrl.cli.view import view_plans

    raise typer.Exit(view_plans(plans, port, not no_browser, until_closed))


@app.command()
def models() -> None:
    """List the models, their controls and parameters."""
    from ensemble_ctrl.systems import SYSTEMS

    for name, system in SYSTEMS.items():
        controls = ", ".join(f"{n} [{u}]" for n, u in zip(system.controls, system.control_units, strict=True))
        units = system.parameter_units
        parameters = ", ".join(f"{n} [{units[n]}]" if n in units else n for n in system.parameters)
        say(f"{name:<18}{system.summary}\n{'':<18}controls {controls}; parameters {parameters}")
        say(f"{'':<18}states {', '.join(system.states)}")
    say("your own: fleet: {model: {python: my_system.py:MySystem}}, with --trust")


@app.command(
    epilog=examples_of(
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
    epilog=examples_of(
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
    epilog=examples_of(
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
