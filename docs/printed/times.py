"""What benchmarks measured on one machine: each writes a file, from which the pages are made."""

from __future__ import annotations

import statistics
from collections.abc import Iterator, Sequence

import numpy as np

from printed import table
from printed.table import Rows, Timed, header, metres


def programs_lines(rows: Rows, machine: str) -> Iterator[str]:
    """The planner and programs written by hand."""
    yield from header("program", "guess", "process", "iterations", "objective", "clearance of nine robots", "for whom")
    for row in rows:
        objective = f"{row['objective']:.2f}".replace("-", "−")
        cells = (row["program"], row["guess"], seconds(row["process"]), str(row["iterations"]), objective)
        yield f"| {' | '.join(cells)} | {metres(row['clearance'])} | {row['whom']} |"
    yield from ("", f"Time of a whole process, median of {rows[0]['runs']}, on {machine}.")


def finding_lines(rows: Rows, machine: str) -> Iterator[str]:
    """Plans found and proven, per family and program."""
    counted = ("found", "proven", "wrong")
    yield from header("family", "program", "tried", *counted, "median time", "above the best known")
    for row in rows:
        counts = (str(row[name]) for name in counted)
        tried = f"{row['tried']} of {row['of']}"
        more = "–" if row["above_best"] is None else f"{row['above_best']:.2f}"
        yield f"| {' | '.join((row['family'], row['program'], tried, *counts, seconds(row['seconds']), more))} |"
    yield from ("", f"Within {rows[0]['limit']:g} s each, {rows[0]['jobs']} at a time, on {machine}.")


def seconds(value: float) -> str:
    """A time to two digits."""
    if value < 0.995:
        return f"{1e3 * value:.2g} ms" if value < 0.0995 else f"{value:.2f} s"
    return f"{value:.1f} s" if value < 9.95 else f"{value:.0f} s"


def milliseconds(value: float) -> str:
    """A time to two digits, in milliseconds."""
    return f"{float(f'{1e3 * value:.2g}'):.0f} ms"


def loop_lines(rows: Rows, machine: str) -> Iterator[str]:
    """Many runs of one robot, robots outside the range, and several robots."""
    (row,) = rows
    median, most, largest = (milliseconds(value) for value in row["seconds"])
    yield f"The times are those of the processor ({machine}), proof included:"
    yield ""
    yield from header("what", "measured")
    yield f"| endings of {row['runs']} runs | {', '.join(f'{n} `{name}`' for name, n in row['endings'].items())} |"
    collisions = f"{row['collisions']}; {metres(row['clearance'])} is the smallest clearance"
    yield f"| collisions, of true paths at ten samples per step | {collisions} |"
    yield f"| in the goal within its window | {row['in_goal']} |"
    yield f"| replanning: median, 95 %, largest of {row['plans']:,} | {median}, {most}, {largest} |"
    apart = " / ".join(metres(value) for value in row["spread"])
    yield f"| spread of the ends (RMS from their mean), with the loop / under the first plan alone | {apart} |"
    yield from ("", *outside_lines(row["outside"]))


def outside_lines(robots: Rows) -> Iterator[str]:
    """Robots outside the range that is assumed."""
    tractions = ", ".join(f"{one['traction']:g}" for one in robots)
    noticed = _of(len(robots), sum(one["noticed"] for one in robots))
    hit = _of(len(robots), sum(one["clearance"] < 0 for one in robots))
    endings = " or ".join(f"`{name}`" for name in sorted({one["ending"] for one in robots}))
    yield f"Of {len(robots)} robots with a traction outside the assumed range ({tractions}), {noticed} were noticed"
    yield f"and {hit} hit an obstacle. They ended as {endings}."


def _of(total: int, part: int) -> str:
    """A part of several robots in words."""
    return {0: "none", total: "all"}.get(part, str(part))


def several_lines(rows: Rows, machine: str) -> Iterator[str]:
    """Three robots under one broadcast, and one."""
    (row,) = rows
    three, one = ([milliseconds(value) for value in row[key]] for key in ("three", "one"))
    yield f"Replanning takes {three[0]} at the median and {three[2]} at most for these three robots, {one[0]} and"
    yield f"{one[2]} for `ada` alone (processor time, on the machine named above)."


def errors_lines(rows: Rows, machine: str) -> Iterator[str]:
    """Many runs of robots with errors of the model."""
    counted = ("in the goal", "collisions", "smallest clearance", "proofs contradicted")
    yield from header("errors", "runs", "endings", *counted)
    for row in rows:
        endings = ", ".join(f"{n} `{name}`" for name, n in row["endings"].items())
        cells = (row["kind"], row["runs"], endings, row["arrived"], row["collisions"], metres(row["clearance"]))
        yield f"| {' | '.join(map(str, cells))} | {row['wrong']} |"
    median, largest = (max(row["seconds"][k] for row in rows) for k in (0, 2))
    yield ""
    yield f"Replanning takes {milliseconds(median)} at the median and {milliseconds(largest)} at most"
    yield f"(processor time, {machine})."


def front_lines(rows: Rows, machine: str) -> Iterator[str]:
    """What the first page says of the loop."""
    (row,) = rows
    median, most, _ = (milliseconds(value) for value in row["seconds"])
    yield f"Replanning online, proof included, takes {median} at the median and {most} at the 95th percentile"
    yield "(`python benchmarks/online.py`)."


def map_lines(rows: Rows, machine: str) -> Iterator[str]:
    """Grids as pieces, and fields of poles."""
    yield from header("", "pieces", "time")
    for row in rows:
        yield f"| {row['what']} | {row['pieces']} | {seconds(row['seconds'])} |"
    yield from ("", f"(`python benchmarks/maps.py`; {machine}.)")


def proof_lines(rows: Rows, machine: str) -> Iterator[str]:
    """Plans and proofs of systems that are defined by an ODE."""
    yield from header("problem", "proven", "plan and proof", "proof alone", "radius of the position")
    for row in rows:
        times = f"{seconds(row['plan'])} | {seconds(row['proof'])}"
        yield f"| `{row['name']}` | {row['proven']} | {times} | {row['radius']:.0e} m |"
    yield from ("", f"Processor's time, children included, on {machine} (`python benchmarks/proofs.py`).")


def scaling_lines(rows: Rows, machine: str) -> Iterator[str]:
    """How time and memory grow with each size."""
    yield from header("size", "program", "from, to", "time", "memory", "exponents of time, memory", "good")
    for axis, program in dict.fromkeys((row["axis"], row["program"]) for row in rows):
        those = [row for row in rows if (row["axis"], row["program"]) == (axis, program)]
        sizes = [row["size"] for row in those]
        spent, held = ([row[name] for row in those] for name in ("seconds", "megabytes"))
        name = "`ensemble-plan`" if program == "ensemble-plan" else program
        grown = f"{power(exponent(sizes, spent))}, {power(exponent(sizes, held))}" if len(those) > 1 else "–"
        ends = f"{seconds(spent[0])} to {seconds(spent[-1])} | {held[0]:.0f} to {held[-1]:.0f} MB"
        good = f"{sum(row['good'] for row in those)} of {len(those)}"
        yield f"| {axis} | {name} | {sizes[0]:,} to {sizes[-1]:,} | {ends} | {grown} | {good} |"
    yield from ("", f"Processor's time of whole processes, children included, on {machine}.")


PARTS = ("start", "solve", "certify", "replay")


def version_lines(rows: Rows, machine: str) -> Iterator[str]:
    """Two versions on the same problems, side by side."""
    yield from header("problem", "found", "proven", "cost", "iterations", *PARTS)
    for row in rows:
        pair = [row[which] for which in ("before", "after")]
        if not any("failed" in facts for facts in pair):
            told = (lambda f: f["found"], lambda f: f["proven"] == "yes")
            kept = [" → ".join("yes" if tell(facts) else "no" for facts in pair) for tell in told]
            cost = " → ".join(f"{facts['cost']:.4f}".replace("-", "−") for facts in pair)
            work = " → ".join(str(facts["iterations"]) for facts in pair)
            spent = [" → ".join(f"{facts['seconds'][part]:.2f}" for facts in pair) for part in PARTS]
            yield f"| `{row['name']}` | {' | '.join((*kept, cost, work, *spent))} |"
    good = [row for row in rows if not any("failed" in row[which] for which in ("before", "after"))]
    yield ""
    for part in PARTS:
        ratios = [row["after"]["seconds"][part] / max(row["before"]["seconds"][part], 1e-3) for row in good]
        yield f"- {part}: {statistics.median(ratios):.2f} of before, in the median of {len(good)}"
    yield from ("", f"Seconds of the processor, children included, on {machine}.")


def power(value: float) -> str:
    """An exponent to two digits behind the point; that of nothing without a sign."""
    return f"{round(value, 2) + 0.0:.2f}"


def exponent(sizes: Sequence[float], values: Sequence[float]) -> float:
    """The power of the size that fits values best, over the larger half of the sizes."""
    # least squares of log value over log size, of two sizes at least
    first = min(len(sizes) // 2, len(sizes) - 2)
    return float(np.polyfit(np.log(sizes[first:]), np.log(values[first:]), 1)[0])


def replay_lines(rows: Rows, machine: str) -> Iterator[str]:
    """Robot-steps per second, and what the shorter way changes."""
    yield from header("problem", "robot-steps per second", "with every position", "largest difference", "points")
    for row in rows:
        rates = f"{table.power(row['rate'])} | {table.power(row['plain_rate'])} | {table.power(row['difference'])} m"
        yield f"| {row['name']} | {rates} | {row['points']} |"
    yield ""
    yield "Processor's time on one thread, everything judged, for 100,000 members; with every position of every member"
    yield f"computed, for 2,000. The difference is the largest of any robustness and closest approach ({machine})."


def refined_lines(rows: Rows, machine: str) -> Iterator[str]:
    """Certificates as they are, and with the bound of each obstacle refined."""
    yield from header("problem", "proven", "certificate", "with `--each`")
    for row in rows:
        yield f"| {row['name']} | {row['proven']} | {seconds(row['proof'])} | {seconds(row['proof_each'])} |"
    yield ""
    yield f"Processor's time on {machine} (`python benchmarks/replay.py`); the least clearance is the same in both."


def many_lines(rows: Rows, machine: str) -> Iterator[str]:
    """Members against time and memory."""
    yield from header(
        "members", "processor's time", "robot-steps per second", "memory", "violate", "share of the fleet"
    )
    for row in rows:
        share = f"at least {100 * row['share_95'][0]:.8g} %"
        cells = (
            f"{seconds(row['spent'])} | {table.power(row['rate'])} | {row['memory'] / 1e6:.0f} MB | {row['violating']}"
        )
        yield f"| {table.power(row['members'], 1)} | {cells} | {share} |"
    yield ""
    yield "`ensemble-plan replay` on the five obstacles, one process, its start included; memory is the largest"
    yield f"resident set ({machine}; `python benchmarks/replay.py --many 1e6 1e7 1e8`)."


TABLES = {
    "versions": Timed("docs/performance.md", "versions", version_lines),
    "scaling": Timed("docs/benchmarks.md", "scaling", scaling_lines),
    "replay": Timed("docs/replay.md", "replay", replay_lines),
    "replay_many": Timed("docs/replay.md", "replay_many", many_lines),
    "refined": Timed("docs/proof.md", "replay", refined_lines),
    "programs": Timed("docs/benchmarks.md", "programs", programs_lines),
    "finding": Timed("docs/benchmarks.md", "finding", finding_lines),
    "loop": Timed("docs/online.md", "online", loop_lines),
    "several": Timed("docs/online.md", "online", several_lines),
    "loop_errors": Timed("docs/online.md", "online_errors", errors_lines),
    "replanning": Timed("README.md", "online", front_lines),
    "proofs": Timed("docs/proof_systems.md", "proofs", proof_lines),
    "maps": Timed("docs/maps.md", "maps", map_lines),
}
