"""Subcommands that search over ranges of a fleet's parameters; each does its work elsewhere."""

from __future__ import annotations

from typing import Annotated

import typer

from ensemble_ctrl.cli.memory import require_memory
from ensemble_ctrl.cli.root import (
    NAME,
    Config,
    GroupedIn,
    Json,
    NoPlots,
    Overrides,
    Overwrite,
    Quiet,
    Trust,
    UsageError,
    WidestIn,
    app,
    examples_of,
)


@app.command(
    epilog=examples_of(
        "ensemble-plan widest problem.yaml",
        "ensemble-plan widest problem.yaml --parameter traction --tolerance 0.001",
        "ensemble-plan widest fleet.yaml --box start_x --box start_y -o plans/box",
    )
)
def widest(
    context: typer.Context,
    config: Config,
    output: WidestIn = None,
    overrides: Overrides = None,
    tolerance: Annotated[
        float | None,
        typer.Option(help="Find the half width to within this [default: 0.01].", metavar="X", min=1e-4),
    ] = None,
    parameter: Annotated[
        str | None, typer.Option(help="The parameter to widen; the fleet's first otherwise.", metavar="NAME")
    ] = None,
    box: Annotated[
        list[str] | None,
        typer.Option(help="Two parameters: their certified box of the largest area.", metavar="NAME"),
    ] = None,
    json: Json = False,
    quiet: Quiet = False,
    overwrite: Overwrite = False,
    trust: Trust = False,
) -> None:
    """Find the widest parameter range with a certified plan."""
    require_memory()
    from ensemble_ctrl.cli.widest import TOLERANCE, WidestOptions, find_widest

    for name, value in (("--parameter", parameter), ("--tolerance", tolerance)):
        if box and value is not None:
            raise UsageError(f"{name}: expected none with --box, which finds both ranges to 2 %; got {value}")
    names, precise = tuple(box or ()), TOLERANCE if tolerance is None else tolerance
    given = (output, tuple(overrides or ()), precise, parameter, names, json, quiet, overwrite)
    raise typer.Exit(find_widest(WidestOptions(config, *given, command=(NAME, *context.obj))))


@app.command(
    epilog=examples_of(
        "ensemble-plan channels problem.yaml",
        "ensemble-plan channels problem.yaml --at-most 3 -o channels",
        "ensemble-plan verify plans/problem-channels/channel-1",
    )
)
def channels(
    context: typer.Context,
    config: Config,
    output: GroupedIn = None,
    overrides: Overrides = None,
    at_most: Annotated[
        int | None,
        typer.Option(
            "--at-most",
            help="Channels allowed; find what clearance each number keeps.",
            metavar="K",
            min=1,
        ),
    ] = None,
    clearance: Annotated[
        float, typer.Option(help="Metres that every channel keeps of obstacles, at least.", metavar="X", min=0.0)
    ] = 0.0,
    tolerance: Annotated[
        float, typer.Option(help="Cut ranges to within this share of them.", metavar="X", min=1e-3, max=1.0)
    ] = 0.01,
    json: Json = False,
    quiet: Quiet = False,
    no_plots: NoPlots = False,
    overwrite: Overwrite = False,
    trust: Trust = False,
) -> None:
    """Find the fewest broadcast channels for a fleet."""
    require_memory()
    from ensemble_ctrl.cli.channels import ChannelOptions, find_channels

    given = (output, tuple(overrides or ()), at_most, clearance, tolerance, json, quiet, not no_plots, overwrite)
    raise typer.Exit(find_channels(ChannelOptions(config, *given, command=(NAME, *context.obj))))
